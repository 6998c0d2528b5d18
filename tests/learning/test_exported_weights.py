"""Weights as they leave a training, and those that are bundled: one set of rules for all."""

from __future__ import annotations

import functools
import json
import re
from functools import partial

import pytest
import torch

from baselines.occupancy_net import weights as occupancy_net
from baselines.splat_net import weights as splat_net
from data_prep.failures import BadInput
from learning import checkpoint
from learning.weights import file_sha256, find_file, objective_of, read_safetensors
from pc2pix import weights as pc2pix

from .trainings import TRAININGS
from .weight_files import whole

# How a network is exported, and where its checkpoint has what is exported.
EXPORTS = {
    "gan": (pc2pix.export, "average.generator.conv.weight"),
    "decoder": (pc2pix.export_decoder, "decoder.layers.1.weight"),
    "splat-net": (partial(splat_net.export, head="grey"), "average.lift.0.weight"),
    "fused-net": (
        partial(splat_net.export, head="grey", kind="fused-net"),
        "average.first.conv.weight",
    ),
    "occupancy-net": (occupancy_net.export, "average.planes.code.weight"),
}
OBJECTIVES = {"gan": "acgan-code", "decoder": "", "splat-net": "l1-patch", "occupancy-net": ""}
OBJECTIVES["fused-net"] = "l1"
OF = {"pc2pix": pc2pix, "splat-net": splat_net, "occupancy-net": occupancy_net}


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """The checkpoint of one step: `trained("gan")`."""

    @functools.cache
    def of_kind(name):
        return TRAININGS[name](tmp_path_factory.mktemp(name) / "run", 1)

    return of_kind


@pytest.mark.parametrize("name", EXPORTS)
def test_what_is_exported(name, trained, tmp_path):
    """Kernels in float16, everything of one dimension as it is, and how it was trained."""
    export, key = EXPORTS[name]
    sha256 = export(trained(name), tmp_path / "w.safetensors")
    assert sha256 == file_sha256(tmp_path / "w.safetensors")
    tensors, header = read_safetensors(tmp_path / "w.safetensors")
    assert {"seed", "batch", "data", "steps"} <= json.loads(header["training"]).keys()
    assert objective_of(tmp_path / "w.safetensors") == OBJECTIVES[name]
    assert not any(stored.endswith("num_batches_tracked") for stored in tensors)
    for value in tensors.values():
        assert value.dtype == (torch.float32 if value.dim() == 1 else torch.float16)
    state, _, _ = checkpoint.load(trained(name), TRAININGS[name].kind)
    stored = next(k for k in tensors if key.endswith(k))
    assert torch.equal(tensors[stored], state[key].half())
    assert [path.name for path in tmp_path.iterdir()] == ["w.safetensors"]


@pytest.mark.parametrize("name", EXPORTS)
def test_values_beyond_float16_are_not_exported(name, trained, tmp_path):
    export, key = EXPORTS[name]
    state, step, config = checkpoint.load(trained(name), TRAININGS[name].kind)
    state[key].fill_(1e6)
    path, out = tmp_path / "big.safetensors", tmp_path / "out.safetensors"
    checkpoint.save(path, TRAININGS[name].kind, step, config, state)
    with pytest.raises(BadInput, match=r"\.weight reaches 1e\+06, beyond float16; "):
        export(path, out)
    assert not out.exists()


@pytest.mark.parametrize("name", EXPORTS)
def test_checkpoints_of_another_kind_are_not_exported(name, tmp_path):
    path = tmp_path / "other.safetensors"
    checkpoint.save(path, "other", 1, {}, {"x": torch.zeros(1)})
    with pytest.raises(BadInput, match=rf"expected a checkpoint .*{TRAININGS[name].kind}"):
        EXPORTS[name][0](path, tmp_path / "w.safetensors")


def test_a_failed_write_leaves_the_old_file(trained, tmp_path, monkeypatch):
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
    ("kind", "name"), [(kind, name) for kind, module in OF.items() for name in module.BUNDLED]
)
def test_bundled_weights_load_and_are_small(kind, name):
    module = OF[kind]
    loaded = module.load_weights(name)
    assert re.fullmatch("[0-9a-f]{64}", loaded.sha256)
    most = {"pc2pix": 10e6, "splat-net": 4e6, "occupancy-net": 4e6}[kind]
    assert module.find_weights(name).stat().st_size < most
    titles = [card.read_text().splitlines()[0] for card in module.FOLDER.glob("*.md")]
    assert sum(f"`{name}`" in title for title in titles) == 1


def test_names_and_checksums(tmp_path):
    path = tmp_path / "x.safetensors"
    for module in OF.values():
        with pytest.raises(BadInput, match="'no-such-weights' is neither a bundled name"):
            module.load_weights("no-such-weights")
    with pytest.raises(BadInput, match=r"x\.safetensors: the bundled weights are missing"):
        find_file("x", tmp_path, {"x": "0" * 64})
    path.write_bytes(whole("pc2pix"))
    with pytest.raises(BadInput, match="is not the expected 000"):
        find_file("x", tmp_path, {"x": "0" * 64})
    assert find_file("x", tmp_path, {"x": file_sha256(path)}) == path
