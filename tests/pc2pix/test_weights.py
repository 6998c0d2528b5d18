from __future__ import annotations

import re
import shutil
import subprocess
import sys

import pytest
import torch
from safetensors.torch import save_file

from data_prep.failures import BadInput
from pc2pix import checkpoint, weight_files
from pc2pix.weight_files import BUNDLED, FOLDER, file_sha256
from pc2pix.weights import export, load_weights


def test_round_trip(gan_checkpoint, tmp_path):
    path = tmp_path / "w.safetensors"
    sha256 = export(gan_checkpoint, path)
    loaded = load_weights(path)
    assert loaded.sha256 == sha256 == file_sha256(path)
    assert loaded.card["steps"] == 2
    assert loaded.card["objective"] == "acgan-code"
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


@pytest.mark.parametrize("length", [0, 7, 1000, -1])
def test_truncated_file(weights_file, tmp_path, length):
    path = tmp_path / "cut.safetensors"
    path.write_bytes(weights_file.read_bytes()[:length])
    with pytest.raises(BadInput) as error:
        load_weights(path)
    assert one_line(error).startswith(f"{path}: not a whole safetensors file")


def test_not_a_safetensors_file(tmp_path):
    path = tmp_path / "text.safetensors"
    path.write_text("these are not the weights you are looking for")
    with pytest.raises(BadInput, match="not a whole safetensors file"):
        load_weights(path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t, h: t.pop("code_std"), "tensor code_std is missing"),
        (lambda t, h: t.update(extra=torch.zeros(1)), "tensor extra is unknown"),
        (lambda t, h: t.update(code_mean=torch.zeros(5)), "code_mean has shape [5], expected [4]"),
        (lambda t, h: t["code_mean"].fill_(torch.nan), "code_mean is not finite"),
        (lambda t, h: h.update(format="pc2pix-weights-999"), "pc2pix-weights-999"),
        (lambda t, h: h.pop("model"), "header cannot be read"),
        (lambda t, h: h.update(model="{"), "header cannot be read"),
        (lambda t, h: h.update(model='{"depth": 1}'), "header cannot be read"),
    ],
)
def test_wrong_content(weights_file, tmp_path, change, message):
    tensors, header = checkpoint.read_safetensors(weights_file)
    change(tensors, header)
    path = tmp_path / "changed.safetensors"
    save_file(tensors, path, metadata=header)
    with pytest.raises(BadInput) as error:
        load_weights(path)
    assert message in one_line(error)
    assert str(path) in one_line(error)


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
    assert (FOLDER / f"{name}.safetensors").stat().st_size < 8e6
    assert (FOLDER / f"{name}.md").is_file()


def test_importing_the_package_does_not_import_torch():
    code = "import sys, pc2pix; sys.exit('torch' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_the_objective_is_in_the_header(weights_file, tmp_path):
    assert weight_files.objective_of(weights_file) == "acgan-code"
    other = tmp_path / "other.safetensors"
    save_file({"x": torch.zeros(1)}, other)
    assert weight_files.objective_of(other) == ""


def test_the_bundled_sets_are_of_different_objectives():
    found = {name: weight_files.objective_of(weight_files.find_weights(name)) for name in BUNDLED}
    assert found == {"chair": "paired", "chair-acgan": "acgan-code"}
