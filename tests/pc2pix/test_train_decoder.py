from __future__ import annotations

import shutil
from dataclasses import replace

import numpy as np
import pytest
import torch
from safetensors.torch import save_file

from data_prep.failures import BadInput
from learning import checkpoint
from learning.weights import file_sha256
from pc2pix.losses import chamfer
from pc2pix.model import Decoder
from pc2pix.train_decoder import DecoderConfig, _DecoderTrainer
from pc2pix.training_data import AutoencoderData
from pc2pix.weights import (
    BUNDLED_DECODERS,
    decoder_path,
    export_decoder,
    load_decoder,
    load_weights,
)
from tests.learning.trainings import TRAININGS, make_clouds


def trainer(weights):
    """Return the trainer on one cloud of exactly 2,048 points: only their order is drawn."""
    data = AutoencoderData(make_clouds(1))
    config = DecoderConfig(weights=weights.sha256, model=weights.encoder.config, batch=1)
    return _DecoderTrainer(data, weights, config, torch.device("cpu"))


def test_the_loss_falls_and_the_encoder_stays(weights_file):
    # whitened over the three clouds of this file, the code would follow the order of the points
    weights = replace(load_weights(weights_file), code_std=torch.ones(4))
    before = {key: value.clone() for key, value in weights.encoder.state_dict().items()}
    fitting = trainer(weights)
    losses = [float(fitting.take_step()["chamfer"]) for _ in range(40)]
    assert np.mean(losses[-5:]) < 0.5 * losses[0]
    after = weights.encoder.state_dict()
    assert all(torch.equal(before[key], after[key]) for key in before)


def test_the_first_loss_is_chamfer_of_whitened_codes(weights_file):
    weights = load_weights(weights_file)
    random = torch.Generator().manual_seed(0)
    torch.randint(1, (1,), generator=random)
    order = torch.rand(1, 2048, generator=random).argsort(dim=1)[0]
    fed = torch.from_numpy(make_clouds(1))[:, order]
    with torch.random.fork_rng():
        torch.manual_seed(0)
        decoder = Decoder(weights.encoder.config)
    code = (weights.encoder(fed) - weights.code_mean) / weights.code_std
    expected = float(chamfer(decoder(code).detach(), fed))
    actual = float(trainer(weights).take_step()["chamfer"])
    assert actual == pytest.approx(expected, rel=1e-5)


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """Weights, and the checkpoint of a decoder of them."""
    out_dir = tmp_path_factory.mktemp("decoder") / "own"
    return out_dir.with_suffix(".safetensors"), TRAININGS["decoder"](out_dir, 1)


@pytest.fixture
def trained_weights(trained, tmp_path):
    """A copy of the weights with the decoder beside it."""
    path = tmp_path / "own.safetensors"
    shutil.copy(trained[0], path)
    export_decoder(trained[1], decoder_path(path))
    return path


def test_round_trip(trained_weights, trained):
    decoder, sha256 = load_decoder(trained_weights, load_weights(trained_weights))
    assert sha256 == file_sha256(trained_weights.with_name("own-decoder.safetensors"))
    state, _, _ = checkpoint.load(trained[1], "decoder")
    assert not decoder.training
    for key, value in decoder.state_dict().items():
        # float16 keeps 11 bits; below 6e-5 it is subnormal with a spacing of 6e-8
        tolerance = 0 if value.dim() == 1 else 2**-11
        torch.testing.assert_close(value, state[f"decoder.{key}"], rtol=tolerance, atol=3e-8)


def refusal(name_or_path, weights):
    with pytest.raises(BadInput) as error:
        load_decoder(name_or_path, weights)
    assert "\n" not in str(error.value)
    assert f"'bench train decoder --weights {name_or_path}'" in str(error.value)
    return str(error.value)


def test_no_decoder_or_that_of_other_weights(trained_weights):
    weights = load_weights(trained_weights)
    others = replace(weights, sha256="ab" * 32)
    text = refusal(trained_weights, others)
    assert f"belongs to weights of sha256 {weights.sha256}" in text
    assert f"not to these of sha256 {others.sha256}" in text
    text = refusal(trained_weights.with_name("tiny.safetensors"), weights)
    assert "tiny-decoder.safetensors: there is no decoder for these weights" in text


def test_a_bundled_decoder_has_its_checksum(monkeypatch):
    weights = load_weights("chair")
    _, sha256 = load_decoder("chair", weights)
    assert sha256 == BUNDLED_DECODERS["chair"]
    monkeypatch.setitem(BUNDLED_DECODERS, "chair", "0" * 64)
    with pytest.raises(BadInput, match=f"sha256 {sha256} is not the expected {'0' * 64}"):
        load_decoder("chair", weights)


def test_a_decoder_of_another_size(trained_weights):
    path = decoder_path(trained_weights)
    tensors, header = checkpoint.read_safetensors(path)
    save_file(tensors, path, metadata=header | {"model": '{"latent_dim": 5}'})
    assert "its model does not fit" in refusal(trained_weights, load_weights(trained_weights))
