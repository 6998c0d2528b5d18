from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm

from baselines.reconstruction.noise import (
    moments,
    noise_scale,
    noise_share,
)
from data_prep.failures import StageFailure
from tests.baselines.clouds import RADIUS, lattice_sphere

SIGMAS = (0.02, 0.05, 0.10)


def square(count: int = 2048) -> np.ndarray:
    rng = np.random.default_rng(1)
    return np.column_stack([rng.uniform(-1, 1, (count, 2)), np.zeros(count)])


def lifted(points: np.ndarray, sigma: float) -> np.ndarray:
    return points + np.random.default_rng(2).normal(scale=sigma, size=points.shape)


@pytest.mark.parametrize("count", [30, 100, 2048, 5000])
def test_a_plane_has_none(count: int) -> None:
    turn, _ = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))
    assert noise_scale(square(count)) == 0
    # Turned, squares of heights are rounding errors of squares of some 0.1.
    assert noise_scale(square(count) @ turn) < 1e-7


@pytest.mark.parametrize("sigma", SIGMAS)
@pytest.mark.parametrize("shape", [square, lattice_sphere], ids=["plane", "sphere"])
def test_noise_of_known_size(shape, sigma: float) -> None:
    """The 30 % quantile of variances of 24 heights (deviation sqrt(2 / 21) of themselves) is 16 %
    low, 8 % of sigma; in a patch 3.7 times as wide as the noise the plane tilts to take up 10 %
    more. Upwards: at the largest patch the sphere's sag adds a tenth."""
    assert 0.8 * sigma < noise_scale(lifted(shape(), sigma)) < 1.1 * sigma


def test_more_noise_is_more() -> None:
    actual = [noise_scale(lifted(square(), sigma)) for sigma in (0, 0.01, 0.02, 0.05, 0.10, 0.15)]
    assert actual == sorted(actual)


def test_a_smooth_sphere_has_less_than_the_sag_of_a_patch() -> None:
    # 24 of 2,048 points lie within 2 R sqrt(24 / 2048); the sag of that is the square over 2 R.
    sag = 2 * RADIUS * 24 / 2048
    assert 0 < noise_scale(lattice_sphere()) < sag


def test_a_patch_is_at_most_an_eighth_of_the_cloud() -> None:
    """Noise of 0.15 needs patches of 192 points, which count from 1,536 on: 96 see too little."""
    few, enough = (noise_scale(lifted(square(count), 0.15)) for count in (1535, 1536))
    assert few < 0.8 * 0.15 < enough


def test_a_plate_is_no_noise() -> None:
    """Two sides 0.06 apart, whose heights have a deviation of 0.03, which a plane's residual is."""
    plate = square()
    plate[:, 2] = np.random.default_rng(3).choice([-0.03, 0.03], len(plate))
    assert noise_scale(plate) < 0.5 * 0.03


@pytest.mark.parametrize("half", [0.0, 0.5, 1.0, 3.0])
def test_moments_of_a_plate(half: float) -> None:
    """Heights at even quantiles of noise of deviation 1 around both sides, at each corner of a wide
    square: no plane but z = 0 fits better."""
    quantiles = norm.ppf((np.arange(4000) + 0.5) / 4000)
    heights = np.concatenate([quantiles - half, quantiles + half])
    corners = np.repeat([[0.0, 0.0], [0.0, 1.0], [1.0, 0.0], [1.0, 1.0]], len(heights), axis=0)
    variance, kurtosis = moments(np.column_stack([1000 * corners, np.tile(heights, 4)])[None])
    # Quantiles leave out the tails beyond 1 / 8000: 0.1 % of the variance, 0.5 % of the kurtosis.
    assert variance[0] == pytest.approx(1 + half**2, rel=0.002)
    expected = 3 - 2 * (half**2 / (1 + half**2)) ** 2
    assert kurtosis[0] == pytest.approx(expected, rel=0.01)


def test_the_part_that_is_noise() -> None:
    assert [noise_share(kurtosis) for kurtosis in (0.9, 1.0, 2.5, 3.0, 9.0)] == [0, 0, 1, 1, 1]
    # A quarter of the way down from 2.5 to 1, and its root.
    assert noise_share(2.125) == pytest.approx(0.5, abs=1e-12)


def test_it_scales_and_depends_on_no_order() -> None:
    points = lifted(lattice_sphere(), 0.05).astype(np.float32)
    order = np.random.default_rng(0).permutation(len(points))
    estimate = noise_scale(points)
    assert noise_scale(points[order]) == estimate
    assert noise_scale(np.repeat(points, 3, axis=0)) == estimate
    assert noise_scale(8 * points) == pytest.approx(8 * estimate, rel=1e-12)


def test_what_says_nothing_has_none() -> None:
    noisy = lifted(square(29), 0.1)
    assert noise_scale(np.zeros((0, 3))) == 0
    assert noise_scale(np.ones((2000, 3))) == 0
    assert noise_scale(np.repeat(noisy, 100, axis=0)) == 0  # 29 different points
    assert noise_scale(np.linspace(-1, 1, 500)[:, None] * [1, 0, 0]) == 0


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_what_is_not_finite_is_named(value: float) -> None:
    points = square()
    points[3, 1] = value
    with pytest.raises(StageFailure, match="input: 1 of 2048 points are not finite"):
        noise_scale(points)
