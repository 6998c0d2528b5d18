from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
import torch
from scipy.ndimage import gaussian_filter

from bench.judges.judge import darkness, greyscale, load_judge_network
from bench.training.judge import (
    LEARNING_RATE,
    WARM_UP,
    JudgeConfig,
    JudgeScores,
    JudgeSizes,
    JudgeTrainer,
    augment,
    blur,
    blurred,
    contrast,
    judge_data,
    scores_of,
    shape_descriptors,
    train_judge,
)
from data_prep.datasets.objects import GreyObject
from data_prep.datasets.registry import ProceduralObject
from data_prep.rendering.opengl import render
from data_prep.scene import View


@pytest.fixture(scope="module")
def data():
    return judge_data("train", 4, 2)


def test_a_tiny_training(tmp_path, capsys):
    out = tmp_path / "judge.safetensors"
    options = {"seed": 1, "out": out, "folder": tmp_path / "training"}
    sizes = JudgeSizes(batch=4, validation=(3, 2))
    scores = train_judge(5, 2, 1, sizes=sizes, **options)
    assert set(scores) == {"true", "blurred", "neutral"}
    for value in scores.values():
        assert 0 <= value.azimuth_deg <= 180
        assert value.retrieval * 6 == pytest.approx(round(value.retrieval * 6))
    assert load_judge_network(out)
    assert "step 1/1: JudgeScores(" in capsys.readouterr().err
    found = out.read_bytes()
    out.unlink()
    assert train_judge(5, 2, 1, sizes=sizes, **options) == scores
    assert out.read_bytes() == found, "from the checkpoint"


def test_the_best_validation_is_what_is_kept(data):
    """The third of six is the best; scores of NaN never are."""
    values = [(50, 0.1), (20, 0.1), (20, 0.2), (20, 0.1), (math.nan, 0.9), (90, 0.9)]
    scores = (JudgeScores(azimuth, 0.0, share) for azimuth, share in values)
    config = JudgeConfig(steps=6, seed=0)
    training = JudgeTrainer(data, config, data, objects=4, score=lambda *_: next(scores))
    kept = []
    for _ in range(6):
        training.take_step()
        kept.append(training.best["view.bias"].clone())
    assert float(training.best_merit) == pytest.approx(0.2 - 20 / 40)
    assert not torch.equal(kept[1], kept[2])
    assert all(torch.equal(kept[2], later) for later in kept[3:])


def test_the_rate_rises_before_it_falls(data):
    trainer = JudgeTrainer(data, JudgeConfig(steps=200, seed=0), data)
    rates = [trainer.rate(done) for done in range(200)]
    top = round(WARM_UP * 200)
    risen = LEARNING_RATE * np.arange(1, top + 1) / top
    assert rates[: top - 1] == pytest.approx(risen[:-1], rel=1e-12)
    cosine = LEARNING_RATE * (1 + np.cos(np.pi * np.arange(200) / 200)) / 2
    assert rates[top:] == pytest.approx(cosine[top:], rel=1e-12)


def test_images(data):
    chair = ProceduralObject("chair", "train", 3)
    view = View(float(data.azimuth_deg[3, 1]), float(data.elevation_deg[3, 1]))
    assert np.array_equal(data.painted[3, 1], greyscale(render(chair.load(), [view]))[0])
    plain = render(GreyObject(chair).load(), [view])
    assert np.array_equal(data.neutral[3, 1], plain[0, :, :, 0])


def test_contrast_against_the_closed_form():
    # two objects, images in rows i and i + 2: the partner has cosine 1, the two others 0
    for rows, partner in (([0, 1, 0, 1], 10), ([0, 0, 1, 1], 0)):
        expected = -math.log(math.exp(partner) / (math.exp(10) + 2))
        assert contrast(torch.eye(4)[rows]).item() == pytest.approx(expected, abs=1e-5)


def test_scores_of_known_answers(data):
    answers = np.zeros((4, 2, 5), np.float32)
    azimuth = np.radians(data.azimuth_deg + 350)  # ten degrees off, the short way round
    answers[..., 0], answers[..., 1] = 0.3 * np.sin(azimuth), 0.3 * np.cos(azimuth)
    answers[..., 2] = (data.elevation_deg - 2) / 40
    answers[..., 3] = np.arange(4)[:, None]
    answers = answers.reshape(8, -1)
    scores = dataclasses.astuple(scores_of(data, answers, answers))
    np.testing.assert_allclose(scores, (10, 2, 1), atol=1e-4)


def test_blur_against_scipy(data):
    images = darkness(torch.from_numpy(data.painted[:2, 0]))
    both = blur(images, torch.tensor([0.7, 2.0])).numpy()[:, 0]
    for found, image, sigma in zip(both, images.numpy()[:, 0], (0.7, 2.0), strict=True):
        expected = gaussian_filter(image, sigma, mode="constant", radius=6)
        np.testing.assert_allclose(found, expected, atol=1e-5)
    level = 255 - gaussian_filter(255.0 - data.painted[0, 0], 1.5, mode="constant", radius=6)
    assert np.abs(blurred(data.painted[:1, :1], 1.5)[0, 0] - level).max() < 0.51


def test_augmented_images(data):
    painted, neutral = (
        darkness(torch.from_numpy(images).flatten(0, 1)).repeat(10, 1, 1, 1)
        for images in (data.painted, data.neutral)
    )
    before = painted.clone()
    made, again = (augment(painted, neutral, torch.Generator().manual_seed(3)) for _ in range(2))
    assert torch.equal(made, again)
    assert torch.equal(painted, before)
    assert 0 <= made.min() < made.max() <= 1
    assert len(torch.unique(made.flatten(1).mean(1))) == len(made), "each in a way of its own"
    # still that object there: brightness is changed by less than what is seen of the chair
    pairs = zip(made.numpy(), painted.numpy(), strict=True)
    likeness = [np.corrcoef(a.ravel(), b.ravel() > 0)[0, 1] for a, b in pairs]
    assert np.median(likeness) > 0.8
    assert min(likeness) > 0.3


def test_shape_descriptors():
    rng = np.random.default_rng(0)
    clouds = rng.uniform(-0.5, 0.5, (40, 500, 3)).astype(np.float32)
    clouds[:, :, 0] += np.linspace(-0.4, 0.4, 40)[:, None]  # each leans to a side of its own
    numbers = shape_descriptors(clouds)
    assert numbers.shape == (2, 40, 24)
    np.testing.assert_allclose((numbers**2).mean((0, 1)), 1, rtol=1e-4)
    # objects and mirror images together are symmetric: a component is even or odd
    odd = np.einsum("ij,ij->j", *numbers) < 0
    np.testing.assert_allclose(numbers[1], numbers[0] * np.where(odd, -1, 1), atol=1e-3)
    assert odd[0], "to which side it leans is what differs most"
    assert not odd.all()
