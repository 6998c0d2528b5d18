from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest
import torch

from bench.running.export import export
from bench.running.options import Options
from data_prep.failures import BadInput, StageFailure
from data_prep.files.checksums import file_sha256
from data_prep.scene import Mesh, Points
from studies.others_networks import Network
from studies.others_weights import check_repository, draw, times, wanted


@pytest.fixture
def network(tmp_path: Path, monkeypatch) -> Iterator[Network]:
    """Yield a network whose repository, in `tmp_path`, has weights and one commit."""
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.setattr(torch.Tensor, "cuda", torch.Tensor.cuda)
    torch.save(torch.eye(3), tmp_path / "weights.pt")
    git = ["git", "-C", str(tmp_path), "-c", "user.name=a", "-c", "user.email=a@example.org"]
    for command in (["init", "-q"], ["add", "."], ["commit", "-q", "-m", "small"]):
        subprocess.run([*git, *command], check=True)
    head = subprocess.check_output([*git, "rev-parse", "HEAD"], text=True).strip()
    weights = {"weights.pt": file_sha256(tmp_path / "weights.pt")}

    def surface(points: Points) -> Mesh:
        if len(points) < 2048:
            raise StageFailure("small", "too few points")
        return Mesh(np.eye(3, dtype=np.float32), np.array([[0, 1, 2]]), np.array([[9, 9, 9]]))

    facts = ("small", "a/small", head, "MIT", "nothing", "a triangle", ".")
    with patch.dict(sys.modules):  # the study replaces some, in a process of its own
        yield Network(*facts, weights, lambda loaded: surface)


@pytest.mark.parametrize("other", [{"commit": "0" * 40}, {"weights": {"weights.pt": "0" * 64}}])
def test_other_code_and_other_weights_are_refused(tmp_path, network, other):
    with pytest.raises(BadInput, match="not 0000" if "commit" in other else "weights.pt"):
        check_repository(replace(network, **other), tmp_path)


def test_a_stopped_run_draws_what_is_lacking_and_tells_failures(tmp_path, network):
    inputs, tree = tmp_path / "export", tmp_path / "tree"
    export(Options("chair-robustness", conditions=("512",), limit=2, views=2, workers=1), inputs)
    draw(network, tmp_path, inputs, tree, wanted(inputs, "2048", 1))
    (first,) = tree.glob("2048/chair/*/00.png")
    first.write_bytes(b"as it was")
    draw(network, tmp_path, inputs, tree, wanted(inputs, "2048,512", 2))
    assert first.read_bytes() == b"as it was"
    failures = [(row["condition"], row["failure"]) for row in times(tree)]
    assert failures == [("2048", "")] * 2 + [("512", "small: too few points")] * 2
