"""`bench train`: how it ends, and who speaks."""

from __future__ import annotations

import pytest
import torch

import bench.commands.train
from baselines.splat_net.weights import load_weights
from bench.catalogue.methods import find_method
from learning.divergence import TrainingDiverged
from learning.weights import file_sha256


def test_a_training_that_diverged_is_one_line(command, monkeypatch):
    def train(*options):
        raise TrainingDiverged("step 7: g_total is nan; last good checkpoint: step 5, x")

    monkeypatch.setattr(bench.commands.train, "train_gan", train)
    status, out, err = command("train", "gan")
    assert (status, out) == (1, "")
    assert err == (
        "bench: step 7: g_total is nan; last good checkpoint: step 5, x; "
        "a lower learning rate may help\n"
    )


@pytest.mark.parametrize("trained", ["autoencoder", "gan", "decoder"])
def test_only_the_first_process_says_what_was_made(command, monkeypatch, trained):
    monkeypatch.setattr(bench.commands.train, f"train_{trained}", lambda options: options.out)
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
    ("asked", "classes"),
    [("chair", ("chair",)), ("chair,sofa", ("chair", "sofa")), ("all", ())],
)
def test_classes_to_train_on(command, monkeypatch, asked, classes):
    trained = []
    train = bench.commands.train
    monkeypatch.setattr(train, "train_autoencoder", lambda o, *_: trained.append(o) or o.out)
    status, _, _ = command("train", "autoencoder", "--class", asked, "--objects", "2")
    assert (status, [options.classes for options in trained]) == (0, [classes])


@pytest.mark.parametrize(
    ("classes", "found"),
    [(("b",), "b0 b1"), (("b", "a"), "b0 b1 a0 a1"), ((), "a0 a1 b0 b1")],
)
def test_objects_of_each_class_are_taken(tmp_path, classes, found):
    for place in ("a/0.ply", "a/1.ply", "a/2.ply", "b/0.ply", "b/1.ply"):
        (tmp_path / place).parent.mkdir(exist_ok=True)
        (tmp_path / place).touch()
    options = bench.commands.train.TrainingOptions(
        dataset=f"folder:{tmp_path}", classes=classes, objects=2, steps=1, out=tmp_path
    )
    objects = bench.commands.train.training_objects(options)
    assert [o.class_name + o.object_id.removesuffix(".ply") for o in objects] == found.split()


def test_splat_net_from_the_command_line_to_a_method(command, tmp_path):
    """Two steps on two chairs; both files are methods, and a longer command goes on."""
    out = tmp_path / "trained"
    options = ("--objects", "2", "--views", "2", "--network", "tiny", "--batch", "4")
    options = (*options, "--cool-down", "1", "--without", "density,discs", "--out", str(out))
    status, said, err = command("train", "splat-net", *options, "--steps", "2")
    assert (status, said) == (0, f"{out / 'weights.safetensors'}\n"), err
    status, _, err = command("train", "splat-net", *options, "--steps", "3")
    assert status == 0, err
    for name, planes in (("weights", 4), ("weights-grey", 2)):
        method = find_method(f"splat-net@{out / name}.safetensors")
        renderer = method.load("cpu")
        network = renderer.weights.network
        assert network.last.out_channels == planes
        # the nearest and the farthest; tiny has neither normals nor flattened points
        assert network.config.inputs.channels == 2
        assert renderer.weights.card["steps"] == 3
        assert renderer.weights.card["learning_rates"] == "0.002"  # the last step is at full rate
        assert method.identity().endswith(renderer.weights.sha256)

    # and from its weights another goes on, without one more input
    start = ("--start", str(out / "weights.safetensors"))
    further = (*options[:-3], "density,discs,far", "--out", str(tmp_path / "further"))
    status, said, err = command("train", "splat-net", *further, *start, "--steps", "1")
    assert status == 0, err
    found = load_weights(said.strip())
    assert found.network.config.inputs.channels == 1
    files = [out / f"{name}.safetensors" for name in ("weights", "weights-grey")]
    assert found.card["start"] == " ".join(file_sha256(file) for file in files)


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ("--network huge", "--network: unknown 'huge'; choose one of tiny, default, large"),
        ("--without colour", "--without colour: there are normals, density, flattened, far, noise"),
        ("--objective l2", "objective: unknown 'l2'; choose one of l1, l1-patch"),
        ("--start chair --network tiny", "--start chair: is of widths (16, 32, 64, 128, 160)"),
        ("--batch 7", "batch 7: 2 views of a cloud are drawn together; use a multiple of 2"),
        ("--views 1", "1 views of an object: at least 2 are drawn together; render more"),
    ],
)
def test_splat_net_refuses_nonsense(command, tmp_path, options, problem):
    out = tmp_path / "x"
    few = ("--objects", "1", "--steps", "1", "--out", str(out))
    status, said, err = command("train", "splat-net", *options.split(), *few)
    assert (status, said) == (2, "")
    assert f"bench: {problem}" in err.splitlines()[-1]
    assert not (out / "weights.safetensors").exists()
