"""`bench train`: how it ends, and who speaks."""

from __future__ import annotations

import pytest
import torch

import bench.train
from learning.divergence import TrainingDiverged


def test_a_training_that_diverged_is_one_line(command, monkeypatch):
    def train(*options):
        raise TrainingDiverged("step 7: g_total is nan; last good checkpoint: step 5, x")

    monkeypatch.setattr(bench.train, "train_gan", train)
    status, out, err = command("train", "gan")
    assert (status, out) == (1, "")
    assert err == (
        "bench: step 7: g_total is nan; last good checkpoint: step 5, x; "
        "a lower learning rate may help\n"
    )


@pytest.mark.parametrize("trained", ["autoencoder", "gan"])
def test_only_the_first_process_says_what_was_made(command, monkeypatch, trained):
    monkeypatch.setattr(bench.train, f"train_{trained}", lambda *options: options[0].out)
    assert command("train", trained, "--out", "here") == (0, "here\n", "")
    monkeypatch.setenv("TORCHELASTIC_RUN_ID", "x")
    monkeypatch.setenv("RANK", "1")
    assert command("train", trained, "--out", "here") == (0, "", "")


def test_cuda_where_there_is_none(command, monkeypatch, tmp_path):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    options = ("--device", "cuda", "--objects", "1", "--out", str(tmp_path / "x"))
    status, out, err = command("train", "autoencoder", *options)
    assert (status, out) == (2, "")
    assert err.splitlines()[-1].startswith(f"bench: --device cuda: PyTorch {torch.__version__}")
    assert not (tmp_path / "x").exists()


@pytest.mark.parametrize(
    ("wish", "classes"),
    [("chair", ("chair",)), ("chair,sofa", ("chair", "sofa")), ("all", ())],
)
def test_classes_to_train_on(command, monkeypatch, wish, classes):
    asked = []
    monkeypatch.setattr(
        bench.train, "train_autoencoder", lambda options, *_: asked.append(options) or options.out
    )
    status, _, _ = command("train", "autoencoder", "--class", wish, "--objects", "2")
    assert (status, [o.classes for o in asked]) == (0, [classes])


@pytest.mark.parametrize(
    ("classes", "found"),
    [
        (("b",), ["b/0", "b/1"]),
        (("b", "a"), ["b/0", "b/1", "a/0", "a/1"]),
        ((), ["a/0", "a/1", "b/0", "b/1"]),
    ],
)
def test_objects_of_each_class_are_taken(tmp_path, classes, found):
    for place in ("a/0", "a/1", "a/2", "b/0", "b/1"):
        (tmp_path / place).with_suffix(".ply").parent.mkdir(exist_ok=True)
        (tmp_path / place).with_suffix(".ply").touch()
    options = bench.train.TrainingOptions(
        f"folder:{tmp_path}", classes, 2, 1, 1, False, "float32", "cpu", 0, None, tmp_path
    )
    objects = bench.train.training_objects(options)
    assert [f"{o.class_name}/{o.object_id.removesuffix('.ply')}" for o in objects] == found
