from __future__ import annotations

import pytest
import torch
from safetensors.torch import save_file

from data_prep.failures import BadInput
from learning import checkpoint
from learning.weights import file_sha256
from pc2pix.weights import export, load_weights


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
