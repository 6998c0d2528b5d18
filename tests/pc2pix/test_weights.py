from __future__ import annotations

import pytest
import torch
from safetensors.torch import save_file

from data_prep.failures import BadInput
from learning import checkpoint
from pc2pix.weights import load_weights


def test_round_trip(gan_checkpoint, weights_file):
    loaded = load_weights(weights_file)
    assert loaded.card["steps"] == 2
    assert loaded.card["objective"] == "acgan-code"
    assert loaded.card["learning_rates"] == "generator 0.0001, discriminator 0.0002"
    model = {"width": 0.0625, "latent_dim": 4, "encoder": "paper", "azimuth": "scalar"}
    assert loaded.card["model"] == model
    state, _, _ = checkpoint.load(gan_checkpoint, "gan")
    assert torch.equal(loaded.code_mean, state["code_mean"])
    assert torch.equal(loaded.code_std, state["code_std"])
    for name, network in (("generator", loaded.generator), ("encoder", loaded.encoder)):
        assert not network.training
        for key, value in network.state_dict().items():
            if not key.endswith("num_batches_tracked"):
                original = state[f"average.{name}.{key}"]
                # float16 keeps 11 bits; below 6e-5 it is subnormal with a spacing of 6e-8
                tolerance = 0 if value.dim() == 1 else 2**-11
                torch.testing.assert_close(value, original, rtol=tolerance, atol=3e-8)


@pytest.mark.parametrize(
    "changes", [{"step": "x"}, {"step": "-1"}, {"config": "["}, {"config": "[]"}, {"config": None}]
)
def test_a_checkpoint_whose_header_is_damaged(tmp_path, changes):
    path = tmp_path / "changed.safetensors"
    checkpoint.save(path, "gan", 1, {}, {"x": torch.zeros(1)})
    tensors, header = checkpoint.read_safetensors(path)
    save_file(tensors, path, {k: v for k, v in (header | changes).items() if v is not None})
    with pytest.raises(BadInput, match="its header cannot be read") as error:
        checkpoint.load(path, "gan")
    assert str(error.value).startswith(f"{path}: ")
    assert "\n" not in str(error.value)
