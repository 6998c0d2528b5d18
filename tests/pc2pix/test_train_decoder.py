from __future__ import annotations

import csv
import shutil
from dataclasses import replace

import numpy as np
import pytest
import torch
from safetensors.torch import save_file

from data_prep.failures import BadInput
from learning import checkpoint
from learning.training_loop import Cadence
from learning.weights import file_sha256
from pc2pix import weights as weight_files
from pc2pix.losses import chamfer
from pc2pix.model import Decoder
from pc2pix.train_autoencoder import AutoencoderData
from pc2pix.train_decoder import DecoderConfig, train_decoder
from pc2pix.weights import decoder_path, export_decoder, load_decoder, load_weights
from tests.learning.trainings import make_clouds


@pytest.fixture(scope="module")
def weights(weights_file):
    return load_weights(weights_file)


@pytest.fixture
def start(weights):
    def start(out_dir, **changes):
        data = AutoencoderData(changes.pop("clouds", make_clouds(3, points=2100)))
        config = DecoderConfig(
            **{"weights": weights.sha256, "model": weights.encoder.config, "batch": 2}
            | {"cadence": Cadence(1, 100, 100)}
            | changes
        )
        return train_decoder(data, weights, config, out_dir)

    return start


@pytest.fixture
def own(weights_file, start, tmp_path):
    """A copy of the weights with a decoder beside it."""
    path = tmp_path / "own.safetensors"
    shutil.copy(weights_file, path)
    export_decoder(start(tmp_path / "training", steps=2), decoder_path(path))
    return path


def read_losses(out_dir):
    with (out_dir / "losses.csv").open(newline="") as file:
        return [float(row["chamfer"]) for row in csv.DictReader(file)]


def test_the_loss_falls_and_the_encoder_stays(start, weights, tmp_path):
    before = {key: value.clone() for key, value in weights.encoder.state_dict().items()}
    start(tmp_path, steps=40, clouds=make_clouds(1))
    losses = read_losses(tmp_path)
    assert np.mean(losses[-5:]) < 0.5 * losses[0]
    after = weights.encoder.state_dict()
    assert all(torch.equal(before[key], after[key]) for key in before)


def test_the_first_loss_is_chamfer_of_whitened_codes(start, weights, tmp_path):
    clouds = make_clouds(1)  # one cloud of exactly 2,048 points: only their order is drawn
    start(tmp_path, steps=1, batch=1, clouds=clouds)
    random = torch.Generator().manual_seed(0)
    torch.randint(1, (1,), generator=random)
    order = torch.rand(1, 2048, generator=random).argsort(dim=1)[0]
    fed = torch.from_numpy(clouds)[:, order]
    with torch.random.fork_rng():
        torch.manual_seed(0)
        decoder = Decoder(weights.encoder.config)
    code = (weights.encoder(fed) - weights.code_mean) / weights.code_std
    expected = float(chamfer(decoder(code).detach(), fed))
    # six digits in the log
    assert read_losses(tmp_path)[0] == pytest.approx(expected, rel=1e-5)


def test_round_trip(own, weights, tmp_path):
    decoder, sha256 = load_decoder(own, weights)
    assert sha256 == file_sha256(tmp_path / "own-decoder.safetensors")
    state, _, _ = checkpoint.load(tmp_path / "training" / checkpoint.FILE_NAME, "decoder")
    assert not decoder.training
    for key, value in decoder.state_dict().items():
        # float16 keeps 11 bits; below 6e-5 it is subnormal with a spacing of 6e-8
        tolerance = 0 if value.dim() == 1 else 2**-11
        torch.testing.assert_close(value, state[f"decoder.{key}"], rtol=tolerance, atol=3e-8)


def refusal(name_or_path, weights):
    with pytest.raises(BadInput) as error:
        load_decoder(name_or_path, weights)
    assert "\n" not in str(error.value)
    return str(error.value)


def test_no_decoder_or_that_of_other_weights(own, weights_file, weights):
    others = replace(weights, sha256="ab" * 32)
    text = refusal(own, others)
    assert f"belongs to weights of sha256 {weights.sha256}" in text
    assert f"not to these of sha256 {others.sha256}" in text
    assert f"'bench train decoder --weights {own}'" in text
    text = refusal(weights_file, weights)
    assert "tiny-decoder.safetensors: there is no decoder for these weights" in text
    assert f"'bench train decoder --weights {weights_file}'" in text


def test_a_bundled_decoder_has_its_checksum(own, weights, monkeypatch, tmp_path):
    monkeypatch.setattr(weight_files, "FOLDER", tmp_path)
    monkeypatch.setitem(weight_files.BUNDLED, "own", weights.sha256)
    found = load_decoder("own", weights)[1]  # not registered: the header has to do
    monkeypatch.setitem(weight_files.BUNDLED_DECODERS, "own", found)
    assert load_decoder("own", weights)[1] == found
    monkeypatch.setitem(weight_files.BUNDLED_DECODERS, "own", "0" * 64)
    assert f"sha256 {found} is not the expected {'0' * 64}" in refusal("own", weights)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"weights": "none"}, "belongs to weights of sha256 none"),
        ({"model": '{"latent_dim": 5}'}, "its model does not fit"),
    ],
)
def test_a_header_of_something_else(own, weights, changes, message):
    path = decoder_path(own)
    tensors, header = checkpoint.read_safetensors(path)
    save_file(tensors, path, metadata=header | changes)
    text = refusal(own, weights)
    assert message in text
    assert "bench train decoder" in text
