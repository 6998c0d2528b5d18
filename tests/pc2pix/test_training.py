from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from data_prep.failures import BadInput
from learning import checkpoint
from learning.training_loop import TrainingDiverged, seeded
from pc2pix import train_autoencoder, train_gan
from pc2pix.model import Encoder, build_encoder
from pc2pix.train_autoencoder import AutoencoderConfig
from pc2pix.train_gan import GanConfig, _GanTrainer
from pc2pix.training_data import AutoencoderData, GanData
from pc2pix.weights import export, load_weights
from tests.learning.trainings import PAIRED, TINY, TRAININGS, make_clouds


def test_non_finite_weights_are_never_saved(tmp_path):
    config = AutoencoderConfig(model=TINY, steps=1, batch=2, learning_rate=math.inf)
    with pytest.raises(TrainingDiverged, match=r"step 1: a weight is NaN.*no checkpoint yet"):
        train_autoencoder.train_autoencoder(AutoencoderData(make_clouds(2)), config, tmp_path)
    assert not (tmp_path / checkpoint.FILE_NAME).exists()


def test_load_encoder(gan_checkpoint, tmp_path):
    config = AutoencoderConfig(model=TINY, steps=1, batch=2)
    path = train_autoencoder.train_autoencoder(AutoencoderData(make_clouds(2)), config, tmp_path)
    encoder = train_autoencoder.load_encoder(path)
    assert not encoder.training
    assert encoder.config == TINY
    trained = checkpoint.sub_state(checkpoint.load(path, "autoencoder")[0], "encoder")
    assert all(torch.equal(value, trained[key]) for key, value in encoder.state_dict().items())
    with pytest.raises(BadInput, match="autoencoder"):
        train_autoencoder.load_encoder(gan_checkpoint)


def test_codes_are_whitened(gan_data, gan_checkpoint):
    state, _, _ = checkpoint.load(gan_checkpoint, "gan")
    encoder = seeded(0, lambda: Encoder(TINY))
    codes = train_gan.encode_clouds(encoder, gan_data.clouds, torch.device("cpu"))
    whitened = (codes - state["code_mean"]) / state["code_std"]
    assert whitened.mean(0).abs().max() < 1e-4  # float32, 1e-7 over a spread of 1e-2
    assert (whitened.std(0, correction=0) - 1).abs().max() < 1e-4


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("images", lambda images: images.astype(np.float32), "images: expected uint8"),
        ("images", lambda images: images[:, :1], r"images: expected uint8 \[3, 2, 128, 128, 3\]"),
        ("clouds", lambda clouds: clouds[:, :1024], r"clouds \[3, 1024, 3\] do not go with"),
        ("elevation_deg", lambda angles: angles[:, :1], r"elevation_deg \[3, 1\] or clouds"),
        ("azimuth_deg", lambda angles: angles + 360, r"azimuth_deg: values .* -180\.\.180"),
        ("elevation_deg", lambda angles: angles * math.nan, r"elevation_deg: .* -40\.\.40"),
        ("elevation_deg", lambda angles: 0 * angles + 40.1, r"elevation_deg: .* -40\.\.40"),
    ],
)
def test_bad_images_angles_and_clouds_are_refused(gan_data, name, change, message):
    with pytest.raises(BadInput, match=message):
        replace(gan_data, **{name: change(getattr(gan_data, name))})


def test_bad_clouds_are_refused():
    clouds = make_clouds(3)
    clouds[1, 5, 0] = math.inf
    with pytest.raises(BadInput, match="cloud 1 is not finite"):
        AutoencoderData(clouds)
    with pytest.raises(BadInput, match=r"2047 points each, training needs 2048.*sample more"):
        AutoencoderData(make_clouds(2, points=2047))
    for wrong in (make_clouds(2).astype(np.float64), make_clouds(0), make_clouds(1)[0]):
        with pytest.raises(BadInput, match=r"expected float32 \[N, M, 3\] with N > 0"):
            AutoencoderData(wrong)


def test_bad_configurations_are_refused(gan_data, tmp_path):
    with pytest.raises(BadInput, match="acgan-paper, acgan-code"):
        GanConfig(objective="wgan")
    with pytest.raises(BadInput, match="same width and latent_dim"):
        train_gan.train_gan(gan_data, Encoder(TINY), GanConfig(), tmp_path)
    with pytest.raises(BadInput, match="warm_up 5: objective acgan-code has no reconstruction"):
        GanConfig(warm_up=5)


def paired_trainer(data, **changes):
    encoder = seeded(0, lambda: build_encoder(PAIRED))
    config = GanConfig(**{"model": PAIRED, "objective": "paired", "batch": 2} | changes)
    return _GanTrainer(data, encoder, config, torch.device("cpu"))


def test_warming_up_leaves_the_discriminator_out_at_a_higher_rate(gan_data):
    trainer = paired_trainer(gan_data, warm_up=2)
    weight = trainer.generator.dense.weight
    assert (weight[:, :128] == 0).all()  # it starts without noise
    assert (weight[:, 128:] != 0).any()
    for step in (1, 2, 3):
        losses = trainer.take_step()
        adversarial = {float(losses[name]) for name in losses if name.startswith(("d_", "g_"))}
        assert (adversarial == {0.0}) == (step <= 2)
        assert (0.0 in adversarial) == (step <= 2)
        rate = trainer.generator_adam.param_groups[0]["lr"]
        assert rate == pytest.approx(4e-4 if step <= 2 else 1e-4)
    expected = "generator 0.0004 up to step 2, then 0.0001, discriminator 0.0002"
    assert trainer.learning_rates(3) == expected
    assert trainer.learning_rates(2) == "generator 0.0004 up to step 2"


def test_paired_trains_the_encoder_and_exports_its_average(tmp_path):
    path = TRAININGS["gan-paired"](tmp_path / "run", 2)
    state, _, _ = checkpoint.load(path, "gan")
    start = seeded(0, lambda: build_encoder(PAIRED)).state_dict()
    trained = checkpoint.sub_state(state, "drawing.encoder")
    assert all(not torch.equal(start[key], trained[key]) for key in start)
    export(path, tmp_path / "w.safetensors")
    loaded = load_weights(tmp_path / "w.safetensors")
    assert loaded.encoder.config == PAIRED
    average = state["average.encoder.points.0.bias"]
    assert torch.equal(loaded.encoder.points[0].bias, average)
    assert not torch.equal(average, trained["points.0.bias"])


def test_the_reconstruction_term_pulls_a_drawn_image_to_the_real_one(gan_data):
    """One object, one view: the error must fall to a fraction of what it was."""
    single = GanData(
        np.full((1, 1, 128, 128, 3), 255, np.uint8),
        np.zeros((1, 1)),
        np.zeros((1, 1)),
        gan_data.clouds[:1],
    )
    single.images[0, 0, 32:96, 32:96] = (200, 40, 90)
    trainer = paired_trainer(single, warm_up=99, generator_lr=1e-3)
    errors = [trainer.take_step()["reconstruction"] for _ in range(60)]
    assert np.mean(errors[-5:]) < 0.25 * np.mean(errors[:5])
