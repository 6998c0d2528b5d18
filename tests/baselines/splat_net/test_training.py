from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest
import torch

from baselines.splat_net.config import VIEWS_TOGETHER, SplatNetConfig
from baselines.splat_net.losses import (
    COVERAGE_WEIGHT,
    GREY_WEIGHT,
    STRUCTURE_WEIGHT,
    coverage_error,
    feature_error,
    tilt_error,
)
from baselines.splat_net.network import COLOUR_HEADS, NetworkConfig, composite
from baselines.splat_net.projection import cameras, project
from baselines.splat_net.surfels import find_surfels, stack
from baselines.splat_net.train import SplatNetTrainer
from data_prep.failures import BadInput
from data_prep.scene import View
from learning.clouds import MAX_NOISE, POINTS_SEEN
from learning.image_losses import weighted_error
from tests.learning.trainings import CADENCE, SMALL

BATCH = 2 * VIEWS_TOGETHER


def configure(**changes):
    defaults = {"network": SMALL, "batch": BATCH, "cadence": CADENCE, "cool_down": 2}
    return SplatNetConfig(**{**defaults, **changes})


def build(data, kind=SplatNetTrainer, features=None, **changes):
    return kind(data, configure(**changes), features=features)


def test_in_the_warm_up_the_judge_learns_and_the_objective_is_l1(data):
    """And losses.csv has the same columns before and after."""
    plain, patches = build(data), build(data, objective="l1-patch", warm_up=1)
    untaught = patches.judge[0].bias.clone()
    for step in (1, 2):  # what the second says is measured before its step
        expected, actual = plain.take_step(), patches.take_step()
        assert {name: actual[name] for name in expected} == expected
        assert list(actual) == ["colour", "grey", "coverage", "judge", "patches"]
        assert actual["judge"] > 0
        assert (actual["patches"] == 0) == (step == 1)
    assert not torch.equal(patches.judge[0].bias, untaught)
    assert not torch.equal(plain.network.last.weight, patches.network.last.weight)


@pytest.mark.parametrize(("objective", "channels"), [("l1-patch", 1), ("pix2pix", 4)])
def test_the_judge_learns_which_images_are_real(data, objective, channels):
    trainer = build(data, objective=objective, judge_lr=1e-2)
    drawn, real = torch.zeros(2, channels, 32, 32), torch.ones(2, channels, 32, 32)
    errors = [trainer._judge(drawn, real)[0].item() for _ in range(20)]
    assert errors[-1] < 0.5 * errors[0]
    on_real, on_drawn = trainer.judge.eval()(torch.cat([real, drawn])).chunk(2)
    assert on_real.mean() > on_drawn.mean() + 0.5
    # what the network makes small is what the judge says of its images, negated
    message = trainer._judge(drawn, real)[1].tolist()
    assert message == pytest.approx((-on_drawn.mean(dim=(1, 2, 3))).tolist(), abs=0.3)


def test_the_last_steps_normalise_by_the_averages_statistics(data):
    trainer = build(data, steps=3, cool_down=2)
    norm, current = trainer.average.first.norm, trainer.network.first.norm
    before = norm.running_var.clone()
    trainer.take_step()
    kept, weights = norm.running_var.clone(), trainer.average.last.weight.clone()
    assert not torch.equal(kept, before)
    for _ in range(2):
        trainer.take_step()
    assert torch.equal(norm.running_var, kept)
    assert torch.equal(current.running_var, kept)
    assert not torch.equal(trainer.average.last.weight, weights)


def maps(images):
    bright = images[:, :1] / 255
    return [torch.cat([bright, 1 - bright], dim=1)[..., ::step] for step in (1, 2)]


@pytest.mark.parametrize(
    ("objective", "colours", "terms"),
    [
        ("l1-patch", "pixel", ()),
        ("relief", "pixel", ("tilt",)),
        ("relief", "image", ("tilt",)),  # leaves everything but the colour to grey
        ("perceptual", "pixel", ("tilt", "features")),
    ],
)
def test_what_is_minimised_is_the_weighted_sum_of_the_terms(data, objective, colours, terms):
    """The judge's opinion counts the more the more noise a cloud has: .05 on a clean one, .2 at the
    strongest noise. Features are those of the first view of each cloud, in grey."""
    heads, judged = COLOUR_HEADS[colours], objective == "l1-patch"
    one, network = "albedo" in heads, dataclasses.replace(SMALL, heads=heads)
    changes = {"objective": objective, "network": network, "seed": 1, "warm_up": int(not judged)}
    trainer = build(data, features=maps, **changes)
    for name, part in (("adam", trainer.network), ("judge_adam", trainer.judge)):
        setattr(trainer, name, torch.optim.SGD(part.parameters(), lr=0.0))
    before = {key: value.clone() for key, value in trainer.state().items()}
    seen, truth, noise = trainer._draw_batch()
    assert noise.min() == 0 < noise.max()
    output = trainer.network.train()(*seen)
    images = dict(zip(heads, composite(output, heads)[1], strict=True))
    grey, colour = images["grey"], images["albedo" if one else "colour"]
    cover = output[:, [1 if one else 4]].sigmoid()
    first = slice(None, None, VIEWS_TOGETHER)
    errors = {
        "tilt": tilt_error(cover, truth.grey, truth.coverage),
        "features": feature_error(grey[first], truth.grey[first], maps),
    }
    total = coverage_error(output[:, :1], truth.coverage) * COVERAGE_WEIGHT
    for drawn, real, weight in (
        (colour, truth.colour, 1),
        (grey, truth.grey, 1 if one else GREY_WEIGHT),
    ):
        total = total + weight * weighted_error(drawn, real, truth.coverage > 0, STRUCTURE_WEIGHT)
    for name in terms:
        total = total + {"tilt": 0.3, "features": 2.0}[name] * errors[name]
    if judged:
        _, patches = trainer._judge(grey, truth.grey)
        total = total + ((0.05 + 0.15 * noise / MAX_NOISE) * patches).mean()
    (expected,) = torch.autograd.grad(total, trainer.network.last.weight)
    trainer.restore(before)
    taken = trainer.take_step()
    for name in terms:
        assert taken[name].item() == pytest.approx(errors[name].item(), rel=1e-5)
    torch.testing.assert_close(trainer.network.last.weight.grad, expected, rtol=1e-4, atol=1e-6)


class Batches(SplatNetTrainer):
    """A trainer whose batches are clouds as they are projected, their views, and their noise."""

    def _scene(self, points, objects, views, mirrored):
        return points, views


def test_batches_are_augmented_as_stated(data):
    """Twelve clouds all of whose points are at the origin: what they are away from it is noise."""
    nowhere = dataclasses.replace(data.seen, clouds=np.zeros_like(data.seen.clouds))
    trainer = build(dataclasses.replace(data, seen=nowhere), Batches, batch=24)
    counts, pairs = set(), set()
    for _ in range(12):
        points, views, noise = trainer._draw_batch()
        counts.add(points.shape[1])
        pairs.update(tuple(sorted(row)) for row in views.tolist())
        assert noise.shape == (24,)
        assert torch.equal(noise[::2], noise[1::2])  # two views of a cloud follow each other
        torch.testing.assert_close(noise[::2], points.std(dim=(1, 2)))
        assert (noise == 0).any()
        assert 0.03 < noise.max() < 1.1 * MAX_NOISE
    assert counts == set(POINTS_SEEN)
    assert pairs == set(itertools.combinations(range(4), VIEWS_TOGETHER))


def test_a_scene_is_what_was_asked_for(data):
    """Two views see each of objects 2 and 1; of the second a mirrored cloud, projected from the
    opposite azimuth: left and right change places."""
    trainer = build(data)
    objects, views = torch.tensor([2, 1]), torch.tensor([[3, 1], [0, 2]])
    clouds = torch.from_numpy(data.seen.clouds)[objects]
    which = torch.tensor([False, True])
    (channels, points), truth = trainer._scene(clouds, objects, views, which)
    pairs = [(2, 3), (2, 1), (1, 0), (1, 2)]
    signs = [1, 1, -1, -1]
    looks = [
        View(sign * data.seen.azimuth_deg[pair], data.seen.elevation_deg[pair])
        for pair, sign in zip(pairs, signs, strict=True)
    ]
    flipped = data.seen.clouds[1] * np.array([-1, 1, 1], np.float32)
    surfels = [find_surfels(cloud) for cloud in (data.seen.clouds[2], flipped)]
    expected = project(stack([surfels[0]] * 2 + [surfels[1]] * 2), cameras(looks), SMALL.inputs)
    assert torch.equal(channels, expected)
    # as the camera sees them: each point of a cloud is as far from its middle as before
    middle = torch.tensor([0.0, 0.0, 4.0])[:, None]
    found = (points[0] + middle).norm(dim=0).sort().values
    far = np.sort(np.linalg.norm(data.seen.clouds[2].astype(np.float64), axis=1))
    np.testing.assert_allclose(found.numpy(), far, rtol=0, atol=1e-5)
    for i, (pair, sign) in enumerate(zip(pairs, signs, strict=True)):
        colour = torch.from_numpy(data.seen.images[pair]).permute(2, 0, 1)
        grey, coverage = (torch.from_numpy(a[pair])[None] for a in (data.grey, data.coverage))
        images = (truth.colour[i], colour), (truth.grey[i], grey), (truth.coverage[i], coverage)
        for image, real in images:
            assert torch.equal(image, (real if sign == 1 else real.flip(2)) / 255)


def test_without_augmentation_clouds_are_whole_and_clean(data):
    trainer = build(data, Batches, augment=False)
    known = {np.sort(np.abs(cloud).ravel()).tobytes() for cloud in data.seen.clouds}
    points, _, noise = trainer._draw_batch()
    assert (noise == 0).all()
    for cloud in points.numpy():
        assert np.sort(np.abs(cloud).ravel()).tobytes() in known  # mirrored or not


@pytest.mark.parametrize("batch", [0, -VIEWS_TOGETHER, VIEWS_TOGETHER + 1])
def test_bad_configurations_are_refused(batch):
    with pytest.raises(BadInput, match=f"batch {batch}: .* multiple of {VIEWS_TOGETHER}"):
        SplatNetConfig(batch=batch)
    with pytest.raises(BadInput, match="colours and grey are trained at once"):
        SplatNetConfig(network=NetworkConfig(heads=("grey",)))
