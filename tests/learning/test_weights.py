"""Weights as they leave a training, and those that are bundled: one set of rules for all."""

from __future__ import annotations

import importlib
import json
from dataclasses import replace

import pytest
import torch

from data_prep.failures import BadInput
from data_prep.files.checksums import file_sha256
from learning import checkpoint
from learning.tensor_files import read_safetensors
from learning.weights import FILES, objective_of
from pc2pix import weights as pc2pix
from pc2pix.train_autoencoder import load_encoder

from .trainings import KINDS, TINY, trained, whole

EXPORTED = {name: kind for name, kind in KINDS.items() if kind.training}
OBJECTIVES = {"pc2pix": "acgan-code", "splat-net": "l1-patch", "fused-net": "l1"}


@pytest.mark.parametrize("name", EXPORTED)
def test_what_is_exported(name, tmp_path):
    """Kernels in float16, everything of one dimension as it is, and how it was trained."""
    kind, path, out = EXPORTED[name], trained(EXPORTED[name].training), tmp_path / "w.safetensors"
    sha256 = kind.write(path, out)
    assert sha256 == file_sha256(out)
    tensors, header = read_safetensors(out)
    training = json.loads(header["training"])
    assert {"seed", "batch", "data"} <= training.keys()
    assert training["steps"] == 1
    assert objective_of(out) == OBJECTIVES.get(name, "")
    state, step, config = checkpoint.load(path, kind.training)
    sources = {
        key: next(k for k in (f"average.{key}", f"decoder.{key}", key) if k in state)
        for key in tensors
        if not key.startswith("last.")  # one head of several
    }
    assert len(sources) > 5
    for key, source in sources.items():
        expected = state[source] if state[source].dim() <= 1 else state[source].half()
        assert torch.equal(tensors[key], expected), key
    assert not any(key.endswith("num_batches_tracked") for key in tensors)
    assert [found.name for found in tmp_path.iterdir()] == ["w.safetensors"]

    out.write_bytes(b"old")
    big = tmp_path / "big.safetensors"
    state[next(s for s in sources.values() if state[s].dim() > 1)].fill_(1e6)
    checkpoint.save(big, kind.training, step, config, state)
    with pytest.raises(BadInput, match=r"\.weight reaches 1e\+06, beyond float16; "):
        kind.write(big, out)
    checkpoint.save(big, "other", 1, {}, {"x": torch.zeros(1)})
    with pytest.raises(BadInput, match=rf"expected a checkpoint .*{kind.training}"):
        kind.write(big, out)
    assert out.read_bytes() == b"old"


def test_the_encoder_of_an_autoencoder():
    encoder = load_encoder(trained("autoencoder"))
    assert not encoder.training
    assert encoder.config == TINY
    state = checkpoint.sub_state(
        checkpoint.load(trained("autoencoder"), "autoencoder")[0], "encoder"
    )
    assert all(torch.equal(value, state[key]) for key, value in encoder.state_dict().items())
    with pytest.raises(BadInput, match="autoencoder"):
        load_encoder(trained("gan"))


def test_a_failed_write_leaves_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "w.safetensors"
    path.write_bytes(b"old")

    def half_written(tensors, name, metadata):
        name.write_bytes(b"half")
        raise OSError("no space left on device")

    monkeypatch.setattr("safetensors.torch.save_file", half_written)
    with pytest.raises(OSError, match="no space"):
        pc2pix.export(trained("gan"), path)
    assert path.read_bytes() == b"old"
    assert [p.name for p in tmp_path.iterdir()] == ["w.safetensors"]


@pytest.mark.parametrize(
    ("package", "name"), [(package, name) for package in FILES for name in FILES[package].bundled]
)
def test_bundled_weights_load_and_have_their_checksums(package, name):
    files = FILES[package]
    path = files.find(name)
    load_weights = importlib.import_module(f"{package}.weights").load_weights
    assert load_weights(name).sha256 == file_sha256(path)
    assert path.stat().st_size < (10e6 if package == "pc2pix" else 4e6)
    titles = [card.read_text().splitlines()[0] for card in files.folder.glob("*.md")]
    assert sum(f"`{name}`" in title for title in titles) == 1
    with pytest.raises(BadInput, match=f"'no-such-weights' is neither a bundled name .*{name}"):
        load_weights("no-such-weights")


def test_names_and_checksums(tmp_path):
    files = replace(FILES["pc2pix"], folder=tmp_path, bundled={"x": "0" * 64})
    with pytest.raises(BadInput, match=r"x\.safetensors: the bundled weights are missing"):
        files.find("x")
    path = tmp_path / "x.safetensors"
    path.write_bytes(whole("pc2pix"))
    with pytest.raises(BadInput, match="is not the expected 000"):
        files.find("x")
    assert replace(files, bundled={"x": file_sha256(path)}).find("x") == path
