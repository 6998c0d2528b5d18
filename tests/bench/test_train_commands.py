"""`bench train`: how it ends, and who speaks."""

from __future__ import annotations

import pytest
import torch

import bench.train
from pc2pix.divergence import TrainingDiverged


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
