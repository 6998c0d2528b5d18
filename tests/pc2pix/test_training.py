from __future__ import annotations

import copy
import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from data_prep.failures import BadInput
from learning import checkpoint
from learning.divergence import TrainingDiverged
from learning.training_loop import seeded, train
from pc2pix import train_gan
from pc2pix.model import Encoder, build_encoder
from pc2pix.train_autoencoder import AutoencoderTrainer
from pc2pix.train_gan import GanTrainer
from pc2pix.training_configs import AutoencoderConfig, GanConfig
from pc2pix.training_data import AutoencoderData
from pc2pix.weights import export, load_weights
from tests.learning.trainings import PAIRED, TINY, TRAININGS, make_clouds

from .conftest import many_objects


def test_non_finite_weights_are_never_saved(tmp_path):
    config = AutoencoderConfig(model=TINY, steps=1, batch=2, learning_rate=math.inf)
    with pytest.raises(TrainingDiverged, match=r"step 1: a weight is NaN.*no checkpoint yet"):
        train(AutoencoderTrainer, AutoencoderData(make_clouds(2)), config, tmp_path)
    assert not (tmp_path / checkpoint.FILE_NAME).exists()


def test_codes_of_a_frozen_encoder_are_whitened(tmp_path):
    data = many_objects()
    given = seeded(0, lambda: Encoder(TINY)).eval()
    before = copy.deepcopy(given.state_dict())
    config = GanConfig(model=TINY, steps=1, batch=2)
    state, _, _ = checkpoint.load(train(GanTrainer, (data, given), config, tmp_path), "gan")
    assert all(torch.equal(value, before[key]) for key, value in given.state_dict().items())
    encoder = Encoder(TINY)
    encoder.load_state_dict(checkpoint.sub_state(state, "average.encoder"))
    raw, codes = (
        train_gan.encode_clouds(network, data.clouds, torch.device("cpu"))
        for network in (given, encoder)
    )
    # a rotation: distances are kept, and variances are sorted
    torch.testing.assert_close(torch.pdist(codes), torch.pdist(raw), rtol=1e-4, atol=1e-6)
    assert (state["code_std"].diff() < 0).all()
    whitened = (codes - state["code_mean"]) / state["code_std"]
    assert whitened.mean(0).abs().max() < 1e-4  # float32, 1e-7 over a spread of 1e-2
    covariance = torch.cov(whitened.T, correction=0)
    torch.testing.assert_close(covariance, torch.eye(4), rtol=0, atol=2e-3)


def wrong_clouds():
    clouds = make_clouds(3)
    clouds[1, 5, 0] = math.inf
    return clouds


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("images", lambda images: images.astype(np.float32), "images: expected uint8"),
        ("images", lambda images: images[:, :1], r"images: expected uint8 \[3, 2, 128, 128, 3\]"),
        ("clouds", lambda clouds: clouds[:, :1024], r"clouds \[3, 1024, 3\] do not go with"),
        ("elevation_deg", lambda angles: angles[:, :1], r"elevation_deg \[3, 1\] or clouds"),
        ("azimuth_deg", lambda angles: angles + 360, r"azimuth_deg: values .* -180\.\.180"),
        ("elevation_deg", lambda angles: angles * math.nan, r"elevation_deg: .* -40\.\.40"),
        ("clouds", lambda _: wrong_clouds(), "cloud 1 is not finite"),
        ("clouds", lambda clouds: clouds[0], r"expected float32 \[N, M, 3\] with N > 0"),
        ("clouds", lambda clouds: clouds.astype(float), "expected float32"),
    ],
)
def test_bad_data_are_refused(gan_data, name, change, message):
    with pytest.raises(BadInput, match=message):
        replace(gan_data, **{name: change(getattr(gan_data, name))})


def test_few_points_and_bad_configurations_are_refused(gan_data, tmp_path):
    with pytest.raises(BadInput, match=r"2047 points each, training needs 2048.*sample more"):
        AutoencoderData(make_clouds(2, points=2047))
    with pytest.raises(BadInput, match="acgan-paper, acgan-code"):
        GanConfig(objective="wgan")
    with pytest.raises(BadInput, match="same width and latent_dim"):
        train(GanTrainer, (gan_data, Encoder(TINY)), GanConfig(), tmp_path)
    with pytest.raises(BadInput, match="warm_up 5: objective acgan-code has no reconstruction"):
        GanConfig(warm_up=5)


def paired_trainer(data, **changes):
    encoder = seeded(0, lambda: build_encoder(PAIRED))
    config = GanConfig(**{"model": PAIRED, "objective": "paired", "batch": 2} | changes)
    return GanTrainer((data, encoder), config)


def test_warming_up_leaves_the_discriminator_out_at_a_higher_rate(gan_data):
    trainer = paired_trainer(gan_data, warm_up=1)
    weight = trainer.generator.dense.weight
    assert (weight[:, :128] == 0).all()  # it starts without noise
    assert (weight[:, 128:] != 0).any()
    for step in (1, 2):
        losses = trainer.take_step()
        adversarial = {float(losses[name]) for name in losses if name.startswith(("d_", "g_"))}
        assert (adversarial == {0.0}) == (step == 1)
        assert (0.0 in adversarial) == (step == 1)
        rate = trainer.generator_adam.param_groups[0]["lr"]
        assert rate == pytest.approx(4e-4 if step == 1 else 1e-4)
    expected = "generator 0.0004 up to step 1, then 0.0001, discriminator 0.0002"
    assert trainer.learning_rates(3) == expected
    assert trainer.learning_rates(1) == "generator 0.0004 up to step 1"


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


def started_trainer(data, start, **changes):
    config = GanConfig(model=TINY, objective="acgan-paper", batch=2, start=start.sha256, **changes)
    return GanTrainer((data, start.encoder), config, start=start)


def test_a_training_starts_from_weights_with_codes_whitened_anew(weights_file):
    data, start = many_objects(), load_weights(weights_file)
    odd = replace(start, code_mean=start.code_mean + 0.1, code_std=torch.full((4,), 0.3))
    trainer = started_trainer(data, odd)
    raw = train_gan.encode_clouds(start.encoder, data.clouds, torch.device("cpu"))
    torch.testing.assert_close(trainer.codes * trainer.code_std + trainer.code_mean, raw)
    assert trainer.codes.mean(0).abs().max() < 1e-4
    inputs = torch.zeros(12, 128), torch.full((12, 1), 0.3), torch.full((12, 1), 0.7)
    expected = start.generator(inputs[0], (raw - odd.code_mean) / odd.code_std, *inputs[1:])
    drawn = trainer.average["generator"](inputs[0], trainer.codes, *inputs[1:])
    torch.testing.assert_close(drawn, expected, rtol=0, atol=1e-5)
    assert not torch.equal(drawn[0], drawn[1])
    # and first the discriminator alone is trained
    trainer = started_trainer(data, start, warm_up=1)
    judged = trainer.discriminator.real.weight.detach().clone()
    weight = trainer.generator.dense.weight.detach().clone()
    for step in (1, 2):
        losses = trainer.take_step()
        assert not torch.equal(trainer.discriminator.real.weight, judged)
        assert torch.equal(trainer.generator.dense.weight, weight) == (step == 1)
        assert (float(losses["g_total"]) == 0) == (step == 1)
        assert float(losses["d_total"]) > 0
    assert trainer.learning_rates(3).startswith("generator 0 up to step 1, then 0.0001, discrim")
