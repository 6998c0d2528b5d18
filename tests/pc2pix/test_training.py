from __future__ import annotations

import csv
import math

import numpy as np
import pytest
import torch

from data_prep.failures import BadInput
from learning import checkpoint
from learning.training_loop import Cadence, TrainingDiverged, seeded
from pc2pix import train_autoencoder, train_gan
from pc2pix.model import Encoder, ModelConfig, build_encoder
from pc2pix.train_autoencoder import AutoencoderConfig, AutoencoderData
from pc2pix.train_gan import GanConfig, GanData
from pc2pix.weights import export, load_weights
from tests.learning.trainings import trainer_of

from .conftest import TINY, make_clouds

PAIRED = ModelConfig(width=0.0625, latent_dim=4, encoder="pointnet", azimuth="sine-cosine")


def read_log(out_dir):
    with (out_dir / "losses.csv").open(newline="") as file:
        return list(csv.reader(file))


def test_non_finite_weights_are_never_saved(tmp_path):
    config = AutoencoderConfig(model=TINY, steps=1, batch=2, learning_rate=math.inf)
    with pytest.raises(TrainingDiverged, match=r"step 1: a weight is NaN.*no checkpoint yet"):
        train_autoencoder.train_autoencoder(AutoencoderData(make_clouds(2)), config, tmp_path)
    assert not (tmp_path / checkpoint.FILE_NAME).exists()


def test_checkpoints_of_another_kind_are_refused(gan_checkpoint):
    with pytest.raises(BadInput, match="autoencoder"):
        train_autoencoder.load_encoder(gan_checkpoint)


def test_load_encoder(tmp_path):
    config = AutoencoderConfig(model=TINY, steps=1, batch=2)
    path = train_autoencoder.train_autoencoder(AutoencoderData(make_clouds(2)), config, tmp_path)
    encoder = train_autoencoder.load_encoder(path)
    assert not encoder.training
    assert encoder.config == TINY


def test_codes_are_whitened(gan_data, gan_checkpoint):
    state, _, _ = checkpoint.load(gan_checkpoint, "gan")
    encoder = seeded(0, lambda: Encoder(TINY))
    codes = train_gan.encode_clouds(encoder, gan_data.clouds, torch.device("cpu"))
    whitened = (codes - state["code_mean"]) / state["code_std"]
    assert whitened.mean(0).abs().max() < 1e-4  # float32, 1e-7 over a spread of 1e-2
    assert (whitened.std(0, correction=0) - 1).abs().max() < 1e-4


def replaced(data, **changes):
    fields = ("images", "azimuth_deg", "elevation_deg", "clouds")
    return GanData(**{name: getattr(data, name) for name in fields} | changes)


def test_bad_data_is_refused(gan_data):
    with pytest.raises(BadInput, match="images: expected uint8"):
        replaced(gan_data, images=gan_data.images.astype(np.float32))
    with pytest.raises(BadInput, match="clouds"):
        replaced(gan_data, clouds=make_clouds(3, points=1024))
    with pytest.raises(BadInput, match="azimuth_deg"):
        replaced(gan_data, azimuth_deg=gan_data.azimuth_deg + 360)
    with pytest.raises(BadInput, match="elevation_deg"):
        replaced(gan_data, elevation_deg=gan_data.elevation_deg * math.nan)
    clouds = make_clouds(3)
    clouds[1, 5, 0] = math.inf
    with pytest.raises(BadInput, match="cloud 1 is not finite"):
        AutoencoderData(clouds)
    with pytest.raises(BadInput, match="sample more points"):
        AutoencoderData(make_clouds(2, points=100))
    with pytest.raises(BadInput, match="expected float32"):
        AutoencoderData(make_clouds(2).astype(np.float64))


def test_bad_configurations_are_refused(gan_data, tmp_path):
    with pytest.raises(BadInput, match="acgan-paper, acgan-code"):
        GanConfig(objective="wgan")
    with pytest.raises(BadInput, match="same width and latent_dim"):
        train_gan.train_gan(gan_data, Encoder(TINY), GanConfig(), tmp_path)
    with pytest.raises(BadInput, match="warm_up 5: objective acgan-code has no reconstruction"):
        GanConfig(warm_up=5)


@pytest.fixture(scope="session")
def paired_checkpoint(gan_data, tmp_path_factory):
    config = GanConfig(
        model=PAIRED, objective="paired", warm_up=2, steps=3, batch=2, cadence=Cadence(1, 9, 1)
    )
    encoder = seeded(0, lambda: build_encoder(PAIRED))
    return train_gan.train_gan(gan_data, encoder, config, tmp_path_factory.mktemp("paired"))


def test_warming_up_leaves_the_discriminator_out(paired_checkpoint):
    header, *rows = read_log(paired_checkpoint.parent)
    adversarial = [i for i, name in enumerate(header) if name.startswith(("d_", "g_"))]
    of_step = {row[0]: {float(row[i]) for i in adversarial} for row in rows}
    assert of_step["1"] == of_step["2"] == {0.0}
    assert 0.0 not in of_step["3"]


def test_paired_trains_the_encoder_and_exports_its_average(paired_checkpoint, tmp_path):
    state, _, _ = checkpoint.load(paired_checkpoint, "gan")
    start = seeded(0, lambda: build_encoder(PAIRED)).state_dict()
    trained = checkpoint.sub_state(state, "drawing.encoder")
    assert all(not torch.equal(start[key], trained[key]) for key in start)
    export(paired_checkpoint, tmp_path / "w.safetensors")
    loaded = load_weights(tmp_path / "w.safetensors")
    assert loaded.encoder.config == PAIRED
    average = state["average.encoder.points.0.bias"]
    assert torch.equal(loaded.encoder.points[0].bias, average)
    assert not torch.equal(average, trained["points.0.bias"])


def test_the_card_says_the_learning_rates_that_there_were(paired_checkpoint, tmp_path):
    export(paired_checkpoint, tmp_path / "w.safetensors")
    expected = "generator 0.0004 up to step 2, then 0.0001, discriminator 0.0002"
    assert load_weights(tmp_path / "w.safetensors").card["learning_rates"] == expected


def test_paired_starts_without_noise(gan_data, tmp_path):
    encoder = seeded(0, lambda: build_encoder(PAIRED))
    config = GanConfig(model=PAIRED, objective="paired")
    trainer = trainer_of(train_gan.train_gan, gan_data, encoder, config, tmp_path)
    weight = trainer.generator.dense.weight
    assert (weight[:, :128] == 0).all()
    assert (weight[:, 128:] != 0).any()


def test_the_reconstruction_term_pulls_a_drawn_image_to_the_real_one(gan_data, tmp_path):
    """One object, one view: the error must fall to a fraction of what it was."""
    one = GanData(
        np.full((1, 1, 128, 128, 3), 255, np.uint8),
        np.zeros((1, 1)),
        np.zeros((1, 1)),
        gan_data.clouds[:1],
    )
    one.images[0, 0, 32:96, 32:96] = (200, 40, 90)
    encoder = seeded(0, lambda: build_encoder(PAIRED))
    config = GanConfig(model=PAIRED, objective="paired", warm_up=99, batch=2, generator_lr=1e-3)
    trainer = trainer_of(train_gan.train_gan, one, encoder, config, tmp_path)
    errors = [trainer.take_step()["reconstruction"] for _ in range(60)]
    assert np.mean(errors[-5:]) < 0.25 * np.mean(errors[:5])
