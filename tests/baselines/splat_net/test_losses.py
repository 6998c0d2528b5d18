from __future__ import annotations

import math

import pytest
import torch

from baselines.splat_net.losses import (
    OBJECTIVES,
    STRUCTURE_WEIGHT,
    PatchJudge,
    coverage_error,
    feature_error,
    judge_error,
    tilt_error,
)
from baselines.splat_net.network import NEUTRAL
from learning.image_losses import FOREGROUND_WEIGHT, structural_similarity

image_error = OBJECTIVES["l1"].image_error


def scene(channels=3, size=32):
    """A white image whose upper half the object covers, by a quarter at least."""
    real = torch.ones(1, channels, size, size, dtype=torch.float64)
    coverage = torch.zeros(1, 1, size, size, dtype=torch.float64)
    coverage[:, :, : size // 2] = 0.25
    real[:, 0, : size // 2] = 0.5
    return real, coverage


@pytest.mark.parametrize("channels", [1, 3])
def test_image_error_counts_the_object_three_times(channels):
    real, coverage = scene(channels)
    assert abs(image_error(real, real, coverage).item()) < 1e-12
    for half, weight in ((slice(0, 16), FOREGROUND_WEIGHT), (slice(16, 32), 1.0)):
        drawn = real.clone()
        drawn[:, 0, half] -= 0.2
        structure = 1 - structural_similarity(drawn, real)
        assert structure > 0.01
        expected = weight * 0.2 / channels / 2 + STRUCTURE_WEIGHT * structure
        assert abs(image_error(drawn, real, coverage) - expected) < 1e-12


def test_a_plain_error_counts_all_pixels_alike():
    real, coverage = scene()
    drawn = real.clone()
    drawn[:, :, 20:24] -= 0.4
    assert OBJECTIVES["pix2pix"].image_error(drawn, real, coverage) == pytest.approx(0.4 * 4 / 32)


def test_coverage_error_by_hand():
    logits = torch.full((1, 1, 1, 2), math.log(3), dtype=torch.float64)  # 3/4
    coverage = torch.tensor([[[[0.5, 0.0]]]], dtype=torch.float64)
    covered = -0.5 * math.log(3 / 4) - 0.5 * math.log(1 / 4)
    free = -math.log(1 / 4)
    expected = (FOREGROUND_WEIGHT * covered + free) / 2
    assert coverage_error(logits, coverage).item() == pytest.approx(expected, rel=1e-12)
    sure = torch.full((1, 1, 2, 2), 200.0)
    assert coverage_error(sure, torch.zeros_like(sure)).item() == 200
    assert coverage_error(sure, torch.ones_like(sure)).item() == 0


def test_judges_are_held_to_margins_of_one():
    real, drawn = torch.tensor([2.0, 0.5, -1.0]), torch.tensor([-2.0, 0.0, 1.0])
    # max(0, 1 - r) is 0, 0.5, 2; max(0, 1 + d) is 0, 1, 2
    assert judge_error(real, drawn).item() == pytest.approx(2.5 / 3 + 3 / 3)
    assert judge_error(torch.ones(5), -torch.ones(5)).item() == 0


@pytest.mark.parametrize("name", [name for name in OBJECTIVES if OBJECTIVES[name].patch_weight])
def test_only_the_judge_of_pix2pix_sees_colours(name):
    """A change of the colours alone changes what it says, and what the colours are taught."""
    torch.manual_seed(0)
    objective = OBJECTIVES[name]
    judge = PatchJudge(objective.judged_channels).eval()
    colour, other = torch.rand(2, 2, 3, 32, 32)
    grey = torch.rand(2, 1, 32, 32).requires_grad_()
    colour = colour.clone().requires_grad_()
    answer, elsewhere = (judge(objective.judged(image, grey)) for image in (colour, other))
    assert torch.equal(answer, elsewhere) == (name != "pix2pix")
    taught = torch.autograd.grad(answer.sum(), [grey, colour], allow_unused=True)
    assert taught[0].abs().sum() > 0
    assert (taught[1] is None) == (name != "pix2pix")


def test_patches_of_a_judge():
    torch.manual_seed(0)
    judge = PatchJudge(4).eval()
    images = torch.rand(2, 4, 64, 64)
    actual = judge(images)
    assert actual.shape == (2, 1, 8, 8)
    # what a patch sees: 22 px of the three halvings, and 16 more of the last kernel
    images[:, :, 40:] = 0.5
    assert torch.equal(judge(images)[:, :, 0], actual[:, :, 0])


def shaded(tilt_deg: float) -> float:
    """Return the grey of a face tilted away from the view."""
    return NEUTRAL * math.cos(math.radians(tilt_deg)) ** (1 / 2.2)


@pytest.mark.parametrize(("true", "drawn"), [(20.0, 40.0), (60.0, 80.0)])
def test_tilt_error_of_planes_is_nearly_the_difference_of_their_angles(true, drawn):
    whole = torch.ones(1, 1, 8, 8, dtype=torch.float64)
    error = tilt_error(whole * shaded(drawn), whole * shaded(true), whole).item()
    # sqrt(1 - cos t) = sqrt(2) sin(t / 2), whose slope falls from .0123 to .0087 a degree
    # between 0 and 90 degrees
    assert 0.0087 < error / 20 < 0.0124
    tilts = (math.sqrt(1 - math.cos(math.radians(t)) + 0.01) for t in (drawn, true))
    assert error == pytest.approx(next(tilts) - next(tilts))


def test_a_crease_that_is_missing_counts_where_brightness_hardly_does():
    whole = torch.ones(1, 1, 4, 8, dtype=torch.float64)
    true = whole * shaded(0)
    true[..., 4:] = shaded(30)
    flat = whole * shaded(0)
    step = math.sqrt(1 - math.cos(math.radians(30)) + 0.01) - math.sqrt(0.01)
    # half of the pixels are wrong, and one of seven differences across; none of those down
    assert tilt_error(flat, true, whole).item() == pytest.approx(step / 2 + step / 7)


def test_tilts_are_compared_in_pixels_that_are_covered_whole():
    coverage = torch.ones(1, 1, 4, 4, dtype=torch.float64)
    coverage[..., 2:] = 0.5
    true, drawn = coverage * shaded(10), coverage * shaded(10)
    drawn[..., 2:] = 0.1
    assert tilt_error(drawn, true, coverage) == 0


def test_features_are_compared_by_their_directions():
    """One map turns by an angle between the images, the other is the same whatever its length."""

    def maps(images: torch.Tensor) -> list[torch.Tensor]:
        assert images.shape == (2, 3, 4, 4)
        angle = images[:, :1] / 255
        turned = torch.cat([angle.cos(), angle.sin()], dim=1)
        longer = images[:, :1] * torch.tensor([3.0, 4.0]).reshape(1, 2, 1, 1)
        return [5 * turned, longer]

    real, drawn = torch.full((2, 1, 4, 4), 0.2), torch.full((2, 1, 4, 4), 0.7, requires_grad=True)
    error = feature_error(drawn, real, maps)
    # Two directions at an angle t are 2 sin(t / 2) apart; two maps count alike.
    assert error.item() == pytest.approx((2 * math.sin(0.25)) ** 2 / 2, rel=1e-5)
    error.backward()
    assert drawn.grad is not None
    assert drawn.grad.sum().item() == pytest.approx(2 * math.sin(0.5) / 2, rel=1e-5)
    assert feature_error(real, real, maps).item() == 0
    assert feature_error(torch.zeros_like(real), torch.zeros_like(real), maps).item() == 0
