from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from safetensors.torch import save_file

from data_prep.failures import BadInput
from learning import checkpoint
from pc2pix.losses import chamfer
from pc2pix.model import Decoder
from pc2pix.train_decoder import DecoderTrainer
from pc2pix.training_configs import DecoderConfig
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
    return DecoderTrainer(data, config, weights=weights)


def test_the_loss_is_chamfer_of_whitened_codes_and_falls_and_the_encoder_stays(weights_file):
    # whitened over the three clouds of this file, the code would follow the order of the points
    weights = replace(load_weights(weights_file), code_std=torch.ones(4))
    before = {key: value.clone() for key, value in weights.encoder.state_dict().items()}
    random = torch.Generator().manual_seed(0)
    torch.randint(1, (1,), generator=random)
    order = torch.rand(1, 2048, generator=random).argsort(dim=1)[0]
    fed = torch.from_numpy(make_clouds(1))[:, order]
    with torch.random.fork_rng():
        torch.manual_seed(0)
        decoder = Decoder(weights.encoder.config)
    code = (weights.encoder(fed) - weights.code_mean) / weights.code_std
    expected = float(chamfer(decoder(code).detach(), fed))
    fitting = trainer(weights)
    losses = [float(fitting.take_step()["chamfer"]) for _ in range(30)]
    assert losses[0] == pytest.approx(expected, rel=1e-5)
    assert np.mean(losses[-5:]) < 0.5 * losses[0]
    after = weights.encoder.state_dict()
    assert all(torch.equal(before[key], after[key]) for key in before)


def refusal(name_or_path, weights):
    with pytest.raises(BadInput) as error:
        load_decoder(name_or_path, weights)
    assert "\n" not in str(error.value)
    assert f"'bench train decoder --weights {name_or_path}'" in str(error.value)
    return str(error.value)


def test_no_decoder_or_that_of_other_weights_or_another_size(tmp_path):
    run = tmp_path / "own"
    path = run.with_suffix(".safetensors")
    trained = TRAININGS["decoder"](run, 1)  # which writes its weights there
    weights = load_weights(path)
    assert "own-decoder.safetensors: there is no decoder for" in refusal(path, weights)
    export_decoder(trained, decoder_path(path))
    load_decoder(path, weights)
    others = replace(weights, sha256="ab" * 32)
    text = refusal(path, others)
    assert f"belongs to weights of sha256 {weights.sha256}" in text
    assert f"not to these of sha256 {others.sha256}" in text
    tensors, header = checkpoint.read_safetensors(decoder_path(path))
    save_file(tensors, decoder_path(path), metadata=header | {"model": '{"latent_dim": 5}'})
    assert "its model does not fit" in refusal(path, weights)


def test_a_bundled_decoder_has_its_checksum(monkeypatch):
    weights = load_weights("chair")
    _, sha256 = load_decoder("chair", weights)
    assert sha256 == BUNDLED_DECODERS["chair"]
    monkeypatch.setitem(BUNDLED_DECODERS, "chair", "0" * 64)
    with pytest.raises(BadInput, match=f"sha256 {sha256} is not the expected {'0' * 64}"):
        load_decoder("chair", weights)
