from __future__ import annotations

import json
import re
import shutil

import pytest
import torch
from safetensors.torch import save_file

from baselines.splat_net import weights as weight_files
from baselines.splat_net.network import composite
from baselines.splat_net.train import KIND
from baselines.splat_net.weights import (
    BUNDLED,
    FOLDER,
    FORMAT,
    Weights,
    export,
    find_weights,
    load_weights,
)
from data_prep.failures import BadInput
from learning import checkpoint
from learning.weights import file_sha256, objective_of

from .conftest import SMALL


@pytest.fixture(scope="module")
def weights_file(trained, tmp_path_factory):
    path = tmp_path_factory.mktemp("weights") / "small.safetensors"
    export(trained, path, "colour")
    return path


def one_line(error):
    message = str(error.value)
    assert "\n" not in message
    return message


def changed(weights_file, tmp_path, change):
    tensors, header = checkpoint.read_safetensors(weights_file)
    change(tensors, header)
    path = tmp_path / "changed.safetensors"
    save_file(tensors, path, metadata=header)
    return path


def test_round_trip(trained, tmp_path):
    path = tmp_path / "w.safetensors"
    sha256 = export(trained, path, "grey")
    loaded = load_weights(path)
    assert isinstance(loaded, Weights)
    assert loaded.sha256 == sha256 == file_sha256(path)
    assert loaded.card["steps"] == 2
    assert loaded.card["objective"] == objective_of(path) == "l1"
    rates = "falling linearly from 2e-06 at step 1 to 1e-06 at step 2"  # of 2e-3, over 2,000 steps
    assert loaded.card["learning_rates"] == rates
    assert loaded.card["network"]["heads"] == ("grey",)
    assert loaded.network.config.heads == ("grey",)
    assert loaded.network.config.widths == SMALL.widths
    assert loaded.network.config.inputs == SMALL.inputs
    assert not loaded.network.training
    assert not any(p.requires_grad for p in loaded.network.parameters())
    state, _, _ = checkpoint.load(trained, KIND)
    for key, value in loaded.network.state_dict().items():
        if not key.endswith("num_batches_tracked"):
            original = state[f"average.{key}"]
            if key.startswith("last."):
                original = original[[0, 4]]  # alpha, red, green, blue, grey
            # float16 keeps 11 bits; below 6e-5 it is subnormal with a spacing of 6e-8
            tolerance = 0 if value.dim() == 1 else 2**-11
            torch.testing.assert_close(value, original, rtol=tolerance, atol=3e-8)
    assert [p.name for p in tmp_path.iterdir()] == ["w.safetensors"]


def test_a_file_of_one_head_draws_what_the_trained_network_draws_with_it(trained, tmp_path):
    from baselines.splat_net.network import SplatNet

    state, _, _ = checkpoint.load(trained, KIND)
    both = SplatNet(SMALL).eval().requires_grad_(False)
    both.load_state_dict(checkpoint.sub_state(state, "average"))
    random = torch.Generator().manual_seed(0)
    given = torch.rand(2, SMALL.inputs.channels, 64, 64, generator=random)
    # kernels are stored in float16: here, so that only the heads are compared
    for value in both.parameters():
        if value.dim() > 1:
            value.copy_(value.half())
    alpha, pictures = composite(both(given), ("colour", "grey"))
    for head, expected in zip(("colour", "grey"), pictures, strict=True):
        export(trained, tmp_path / head, head)
        network = load_weights(tmp_path / head).network
        found_alpha, (found,) = composite(network(given), (head,))
        # the same sums, of some 9 x 12 products, by other kernels: some 1e-7
        torch.testing.assert_close(found, expected, rtol=0, atol=1e-5)
        torch.testing.assert_close(found_alpha, alpha, rtol=0, atol=1e-5)
    assert (pictures[0] - pictures[1]).abs().max() > 1e-3


def test_a_head_that_is_not_there(trained, weights_file, tmp_path):
    with pytest.raises(BadInput, match=r"has heads \('colour', 'grey'\), not 'silver'") as error:
        export(trained, tmp_path / "w", "silver")
    assert one_line(error).startswith(f"{trained}: ")
    with pytest.raises(BadInput, match="expected a checkpoint"):
        export(weights_file, tmp_path / "w", "grey")
    assert not list(tmp_path.iterdir())


def test_checkpoints_of_another_kind_are_not_exported(tmp_path):
    path = tmp_path / "gan.safetensors"
    checkpoint.save(path, "gan", 1, {}, {"x": torch.zeros(1)})
    with pytest.raises(BadInput, match=r"expected a checkpoint .*splat-net"):
        export(path, tmp_path / "w.safetensors", "grey")


def test_values_beyond_float16_are_not_exported(trained, tmp_path):
    state, step, config = checkpoint.load(trained, KIND)
    state["average.lift.0.weight"].fill_(1e6)
    path = tmp_path / "big.safetensors"
    checkpoint.save(path, KIND, step, config, state)
    with pytest.raises(BadInput, match=r"lift\.0\.weight reaches 1e\+06, beyond float16; export"):
        export(path, tmp_path / "out.safetensors", "grey")
    assert not (tmp_path / "out.safetensors").exists()


def test_a_failed_write_leaves_the_old_file(trained, weights_file, tmp_path, monkeypatch):
    path = tmp_path / "w.safetensors"
    shutil.copy(weights_file, path)

    def half_written(tensors, name, metadata):
        name.write_bytes(b"half")
        raise OSError("no space left on device")

    monkeypatch.setattr("safetensors.torch.save_file", half_written)
    with pytest.raises(OSError, match="no space"):
        export(trained, path, "grey")
    assert path.read_bytes() == weights_file.read_bytes()
    assert [p.name for p in tmp_path.iterdir()] == ["w.safetensors"]


@pytest.mark.parametrize("name", BUNDLED)
def test_bundled_weights_load_and_are_small(name):
    loaded = load_weights(name)
    assert re.fullmatch("[0-9a-f]{64}", loaded.sha256)
    large = name == "chair-large"  # twice the numbers of `chair`
    assert (FOLDER / f"{name}.safetensors").stat().st_size < (6e6 if large else 4e6)
    titles = [card.read_text().splitlines()[0] for card in FOLDER.glob("*.md")]
    assert sum(f"`{name}`" in title for title in titles) == 1


def test_names(weights_file, tmp_path, monkeypatch):
    with pytest.raises(BadInput, match="'no-such-weights' is neither a bundled name"):
        load_weights("no-such-weights")
    monkeypatch.setattr(weight_files, "FOLDER", tmp_path)
    monkeypatch.setitem(weight_files.BUNDLED, "x", "0" * 64)
    with pytest.raises(BadInput, match=r"x\.safetensors: the bundled weights are missing"):
        find_weights("x")
    shutil.copy(weights_file, tmp_path / "x.safetensors")
    with pytest.raises(BadInput, match="is not the expected 000"):
        find_weights("x")
    monkeypatch.setitem(weight_files.BUNDLED, "x", file_sha256(weights_file))
    assert load_weights("x").sha256 == file_sha256(weights_file)


@pytest.mark.parametrize(
    ("where", "value", "text"),
    [
        ("heads", ["colour", "grey"], "expected one"),
        ("heads", ["silver"], "silver"),
        ("heads", [], "heads"),
        ("heads", [["colour"]], "unhashable"),
        ("heads", "grey", "heads"),
        ("heads", None, "not iterable"),
        ("widths", [4, 6, 8, 10, -12], "each at least 1"),
        ("widths", [4, 6, 8, 10, 0], "each at least 1"),
        ("widths", [4, 6, 8, 10], "expected five numbers"),
        ("widths", [4, 6, 8, 10, 12.0], "widths"),
        ("widths", [4, 6, 8, 10, True], "widths"),
        ("widths", [4, 6, 8, 10, 10**9], "widths"),
        ("widths", [4, 6, 8, 10, "12"], "not supported"),
        ("widths", 5, "not iterable"),
        ("code", 128, "code"),
        ("windows", [], "windows"),
        ("windows", [4, 7], "windows"),
        ("windows", [7, 3], "windows"),
        ("windows", [3, 3], "windows"),
        ("windows", [-3, 7], "windows"),
        ("windows", [True, 7], "windows"),
        ("windows", [3, 65], "windows"),
        ("windows", [3.0, 7], "windows"),
        ("windows", "37", "windows"),
        ("windows", 3, "not iterable"),
        ("windows", [3, 5, 7], "first.conv.weight has shape"),
        ("normals", "yes", "expected true or false"),
        ("normals", 1, "expected true or false"),
        ("density", 1e9, "expected true or false"),
        ("flattened", None, "expected true or false"),
        ("far", False, "has shape"),
        ("more", 1, "more"),
    ],
)
def test_networks_that_nobody_has_trained(weights_file, tmp_path, monkeypatch, where, value, text):
    """Refused before memory is taken for them."""

    def change(tensors, header):
        network = json.loads(header["network"])
        inside = where in ("windows", "normals", "density", "flattened", "far")
        (network["inputs"] if inside else network)[where] = value
        header["network"] = json.dumps(network)

    def outline_only(tensor, *_):
        assert tensor.is_meta, "memory was taken"

    monkeypatch.setattr(torch.nn.init, "uniform_", outline_only)
    with pytest.raises(BadInput) as error:
        load_weights(changed(weights_file, tmp_path, change))
    assert text in one_line(error)


def test_the_largest_network_that_is_taken_for_one(weights_file, tmp_path):
    """Its outline needs no memory: all widths at their limit."""

    def change(tensors, header):
        network = json.loads(header["network"]) | {"widths": [4096] * 5}
        header["network"] = json.dumps(network)

    with pytest.raises(BadInput, match="is missing"):
        load_weights(changed(weights_file, tmp_path, change))


def test_what_is_written(weights_file):
    tensors, header = checkpoint.read_safetensors(weights_file)
    assert header["format"] == FORMAT
    assert {"objective", "seed", "batch", "data", "steps"} <= json.loads(header["training"]).keys()
    assert not any(key.endswith("num_batches_tracked") for key in tensors)
    kinds = {key: value.dtype for key, value in tensors.items()}
    for key, value in tensors.items():
        assert kinds[key] == (torch.float32 if value.dim() == 1 else torch.float16)
    assert tensors["last.weight"].shape == (4, 4, 3, 3)
