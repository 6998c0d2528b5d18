from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys

import pytest
import torch
from safetensors.torch import save_file

from data_prep.failures import BadInput
from learning import checkpoint
from learning import weights as learned_files
from learning.weights import file_sha256, objective_of
from pc2pix import weights as weight_files
from pc2pix.weights import BUNDLED, FOLDER, export, load_weights


def test_round_trip(gan_checkpoint, tmp_path):
    path = tmp_path / "w.safetensors"
    sha256 = export(gan_checkpoint, path)
    loaded = load_weights(path)
    assert loaded.sha256 == sha256 == file_sha256(path)
    assert loaded.card["steps"] == 2
    assert loaded.card["objective"] == "acgan-code"
    assert loaded.card["learning_rates"] == "generator 0.0001, discriminator 0.0002"
    assert loaded.card["model"] == {
        "width": 0.0625,
        "latent_dim": 4,
        "encoder": "paper",
        "azimuth": "scalar",
    }
    state, _, _ = checkpoint.load(gan_checkpoint, "gan")
    assert torch.equal(loaded.code_std, state["code_std"])
    for key, value in loaded.generator.state_dict().items():
        if not key.endswith("num_batches_tracked"):
            original = state[f"average.generator.{key}"]
            # float16 keeps 11 bits; below 6e-5 it is subnormal with a spacing of 6e-8
            tolerance = 0 if value.dim() == 1 else 2**-11
            torch.testing.assert_close(value, original, rtol=tolerance, atol=3e-8)
    assert not loaded.generator.training
    assert not loaded.encoder.training


def one_line(error):
    message = str(error.value)
    assert "\n" not in message
    return message


def test_unknown_name():
    with pytest.raises(BadInput) as error:
        load_weights("no-such-weights")
    assert "'no-such-weights' is neither a bundled name" in one_line(error)


def test_wrong_checksum(weights_file, tmp_path, monkeypatch):
    shutil.copy(weights_file, tmp_path / "x.safetensors")
    monkeypatch.setattr(weight_files, "FOLDER", tmp_path)
    monkeypatch.setitem(weight_files.BUNDLED, "x", "0" * 64)
    with pytest.raises(BadInput) as error:
        load_weights("x")
    assert "is not the expected 000" in one_line(error)
    monkeypatch.setitem(weight_files.BUNDLED, "x", file_sha256(weights_file))
    assert load_weights("x").sha256 == file_sha256(weights_file)


def test_missing_bundled_file(tmp_path, monkeypatch):
    monkeypatch.setattr(weight_files, "FOLDER", tmp_path)
    monkeypatch.setitem(weight_files.BUNDLED, "x", "0" * 64)
    with pytest.raises(BadInput, match=r"x\.safetensors: the bundled weights are missing"):
        load_weights("x")


def test_values_beyond_float16_are_not_exported(gan_checkpoint, tmp_path):
    state, step, config = checkpoint.load(gan_checkpoint, "gan")
    state["average.generator.conv.weight"].fill_(1e6)
    path = tmp_path / "big.safetensors"
    checkpoint.save(path, "gan", step, config, state)
    with pytest.raises(BadInput, match=r"generator\.conv\.weight reaches 1e\+06"):
        export(path, tmp_path / "out.safetensors")


@pytest.mark.parametrize("name", BUNDLED)
def test_bundled_weights_load_and_are_small(name):
    loaded = load_weights(name)
    assert re.fullmatch("[0-9a-f]{64}", loaded.sha256)
    assert (FOLDER / f"{name}.safetensors").stat().st_size < 10e6
    assert (FOLDER / f"{name}.md").is_file()


def test_names_and_checksums_do_not_need_torch():
    packages = "pc2pix, pc2pix.weights, baselines.splat_net.weights, learning.weights"
    code = f"import sys, {packages}; sys.exit('torch' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_the_objective_is_in_the_header(weights_file, tmp_path):
    assert objective_of(weights_file) == "acgan-code"
    other = tmp_path / "other.safetensors"
    save_file({"x": torch.zeros(1)}, other)
    assert objective_of(other) == ""


def raw(header, length=None):
    text = header if isinstance(header, bytes) else json.dumps(header).encode()
    return (len(text) if length is None else length).to_bytes(8, "little") + text


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b"", "Expecting value"),
        (b"\xff" * 8, "18446744073709551615 bytes by its own account"),
        (raw({}, length=3), "3 bytes by its own account"),
        (raw({}, length=2**40), "1099511627776 bytes by its own account"),
        (raw([]), "'list' object"),
        (raw(b"{"), "Expecting"),
        (raw(b"\xff\xff"), "utf-8"),
        (raw(b"[" * 100_000), "recursion"),
        (raw({"__metadata__": 3}), "'int' object"),
        (raw({"__metadata__": {"training": 3}}), "must be str"),
        (raw({"__metadata__": {"training": "["}}), "Expecting"),
        (raw({"__metadata__": {"training": "[]"}}), "'list' object"),
        (raw({"__metadata__": {"training": "[" * 100_000}}), "recursion"),
        (raw({"__metadata__": {"training": '{"objective": 3}'}}), "no short text"),
        (raw({"__metadata__": {"training": json.dumps({"objective": "x" * 101})}}), "no short"),
    ],
)
def test_a_header_that_cannot_be_trusted(tmp_path, content, expected):
    path = tmp_path / "w.safetensors"
    path.write_bytes(content)
    with pytest.raises(BadInput, match=expected) as error:
        objective_of(path)
    assert one_line(error).startswith(f"{path}: its header cannot be read (")


def test_a_long_header_is_not_read(tmp_path, monkeypatch):
    path = tmp_path / "w.safetensors"
    path.write_bytes(raw({"__metadata__": {"note": "x" * 100}}))
    assert objective_of(path) == ""
    monkeypatch.setattr(learned_files, "MOST_HEADER_BYTES", 100)
    with pytest.raises(BadInput, match="bytes by its own account"):
        objective_of(path)


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"width": 1e6}, "width 1000000.0, expected up to 4.0"),
        ({"width": float("inf")}, "width inf, expected up to"),
        ({"width": float("nan")}, "width must be positive, got nan"),
        ({"latent_dim": 10**9}, "latent_dim 1000000000, expected up to 4096"),
        ({"latent_dim": 4.5}, "latent_dim 4.5, expected up to"),
        ({"width": "1"}, "not supported"),
        ({"encoder": ["paper"]}, "encoder must be paper or pointnet"),
        ({"width": 4.0, "latent_dim": 4096}, "has shape|is missing|is unknown"),
    ],
)
def test_a_model_larger_than_its_file_is_never_built(
    weights_file, tmp_path, monkeypatch, changes, expected
):
    tensors, header = checkpoint.read_safetensors(weights_file)
    header["model"] = json.dumps(json.loads(header["model"]) | changes)
    path = tmp_path / "changed.safetensors"
    save_file(tensors, path, metadata=header)

    def outline_only(tensor, *_):
        assert tensor.is_meta, "memory was taken"

    monkeypatch.setattr(torch.nn.init, "uniform_", outline_only)
    with pytest.raises(BadInput, match=expected):
        load_weights(path)


@pytest.mark.parametrize(
    "changes", [{"step": "x"}, {"step": "-1"}, {"config": "["}, {"config": "[]"}, {"config": None}]
)
def test_a_checkpoint_whose_header_is_damaged(gan_checkpoint, tmp_path, changes):
    tensors, header = checkpoint.read_safetensors(gan_checkpoint)
    header = {k: v for k, v in (header | changes).items() if v is not None}
    path = tmp_path / "changed.safetensors"
    save_file(tensors, path, metadata=header)
    with pytest.raises(BadInput, match="its header cannot be read") as error:
        checkpoint.load(path, "gan")
    assert one_line(error).startswith(f"{path}: ")


def test_the_bundled_sets_are_of_different_objectives():
    found = {name: objective_of(weight_files.find_weights(name)) for name in BUNDLED}
    assert found == {"all": "paired", "chair": "paired", "chair-acgan": "acgan-code"}
