"""The estimate of a cloud's noise, the smoothing, and what both leave of a cloud."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm

from baselines.reconstruction.denoised import cleaned, moments, noise_scale, searched, smoothed
from baselines.reconstruction.stages import Nearest, spacing
from data_prep.failures import StageFailure
from data_prep.scene import PointCloud
from tests.baselines.clouds import RADIUS, chair_cloud, lattice_sphere


def square(count: int = 2048) -> np.ndarray:
    rng = np.random.default_rng(1)
    return np.column_stack([rng.uniform(-1, 1, (count, 2)), np.zeros(count)])


def lifted(points: np.ndarray, sigma: float) -> np.ndarray:
    return points + np.random.default_rng(2).normal(scale=sigma, size=points.shape)


def noise_of(points: np.ndarray) -> float:
    return noise_scale(searched(np.unique(points, axis=0))[1])


def smooth(points: np.ndarray, neighbours: int, rounds: int) -> np.ndarray:
    return smoothed(Nearest(points), neighbours, rounds)


def turn() -> np.ndarray:
    return np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]


@pytest.mark.parametrize("count", [30, 2048, 5000])
def test_a_plane_has_no_noise(count: int) -> None:
    assert noise_of(square(count)) == 0
    # Turned, squares of heights are rounding errors of squares of some 0.1.
    assert noise_of(square(count) @ turn()) < 1e-7


@pytest.mark.parametrize("sigma", [0.02, 0.05, 0.10])
@pytest.mark.parametrize("shape", [square, lattice_sphere], ids=["plane", "sphere"])
def test_noise_of_known_size(shape, sigma: float) -> None:
    """The 30 % quantile of variances of 24 heights (deviation sqrt(2 / 21) of themselves) is 16 %
    low, 8 % of sigma; in a patch 3.7 times as wide as the noise the plane tilts to take up 10 %
    more. Upwards: at the largest patch the sphere's sag adds a tenth."""
    assert 0.8 * sigma < noise_of(lifted(shape(), sigma)) < 1.1 * sigma


def test_curvature_and_thickness_are_no_noise() -> None:
    # 24 of 2,048 points lie within 2 R sqrt(24 / 2048); the sag of that is the square over 2 R.
    assert 0 < noise_of(lattice_sphere()) < 2 * RADIUS * 24 / 2048
    plate = square()  # two sides, whose heights have a deviation of 0.03
    plate[:, 2] = np.random.default_rng(3).choice([-0.03, 0.03], len(plate))
    assert noise_of(plate) < 0.5 * 0.03


def test_a_patch_is_at_most_an_eighth_of_the_cloud() -> None:
    """Noise of 0.15 needs patches of 192 points, which count from 1,536 on: 96 see too little."""
    few, enough = (noise_of(lifted(square(count), 0.15)) for count in (1535, 1536))
    assert few < 0.8 * 0.15 < enough


@pytest.mark.parametrize("half", [0.0, 0.5, 1.0, 3.0])
def test_moments_of_a_plate(half: float) -> None:
    """Heights at even quantiles of noise of deviation 1 around both sides, at each corner of a wide
    square: no plane but z = 0 fits better."""
    quantiles = norm.ppf((np.arange(4000) + 0.5) / 4000)
    heights = np.concatenate([quantiles - half, quantiles + half])
    corners = np.repeat([[0.0, 0.0], [0.0, 1.0], [1.0, 0.0], [1.0, 1.0]], len(heights), axis=0)
    points = np.column_stack([1000 * corners, np.tile(heights, 4)])
    variance, kurtosis = moments(points, np.arange(len(points))[None])
    # Quantiles leave out the tails beyond 1 / 8000: 0.1 % of the variance, 0.5 % of the kurtosis.
    assert variance[0] == pytest.approx(1 + half**2, rel=0.002)
    expected = 3 - 2 * (half**2 / (1 + half**2)) ** 2
    assert kurtosis[0] == pytest.approx(expected, rel=0.01)


def test_the_estimate_scales_and_what_says_nothing_has_no_noise() -> None:
    points = lifted(lattice_sphere(), 0.05).astype(np.float32)
    assert noise_of(8 * points) == pytest.approx(8 * noise_of(points), rel=1e-12)
    few = np.repeat(lifted(square(29), 0.1), 100, axis=0)  # 29 different points
    line = np.linspace(-1, 1, 500)[:, None] * [1, 0, 0]
    for cloud in (np.ones((2000, 3)), few, line):
        assert noise_of(cloud) == 0


def test_the_spacing_is_half_the_distance_to_the_sixteenth() -> None:
    """Points lie a unit apart on a line: nearest are itself, seven on each side and the eighth."""
    line = np.arange(100.0)[:, None] * [1.0, 0, 0]
    assert spacing(Nearest(line)) == 4
    assert spacing(Nearest(line[:3])) == 1  # of three the farthest: 2, 1 and 2 away
    near = Nearest(line)
    for count in (2, 5, 3):
        assert near.within(count)[0].shape == (100, count)


def saddle(points: np.ndarray) -> np.ndarray:
    """Return how far points [N, 3] lie above a saddle."""
    x, y, z = points.T
    return z - (0.3 * x * x - 0.2 * x * y - 0.1 * y * y)


def test_smooth_surfaces_stay_as_they_are() -> None:
    """A fit of degree 2 errs where heights over a patch have a third derivative; over the patch's
    own plane, which is tilted by some 0.1 against the saddle's, and on spheres (their fourth)."""
    plane = square(500) @ turn()
    np.testing.assert_allclose(smooth(plane, 40, 3), plane, rtol=0, atol=1e-12)
    points = square()
    points[:, 2] = -saddle(points)
    # A patch of 40 has radius r = 0.16; curvature c = 0.6 tilts by c r, which turns the second
    # derivative into a third of 3 c^2 (c r), and that into a height of this times r^3 / 6.
    error = 3 * 0.6**2 * (0.6 * 0.16) * 0.16**3 / 6
    assert np.abs(saddle(smooth(points, 40, 1))).max() < 2 * error
    # Of a sphere r = 2 R sqrt(40 / 2048) = 0.2 is the radius; the next term is r^4 / (8 R^3).
    radii = np.linalg.norm(smooth(lattice_sphere(), 40, 1), axis=1)
    assert np.abs(radii - RADIUS).max() < 0.2**4 / (8 * RADIUS**3)
    # points of no surface
    line = np.linspace(-1, 1, 50)[:, None] * [1.0, 0, 0]
    for odd in (line, np.ones((50, 3)), np.eye(3)):
        np.testing.assert_allclose(smooth(odd, 12, 3), odd, rtol=0, atol=1e-9)


@pytest.mark.parametrize("count", [512, 2048])
def test_clean_points_stay_as_they_are(count: int) -> None:
    cloud = chair_cloud(count)
    clean = cleaned(cloud, 1.0)
    assert clean.noise == 0
    np.testing.assert_array_equal(clean.points, np.unique(cloud.points, axis=0))
    assert clean.notes == ()


@pytest.mark.parametrize("sigma", [0.05, 0.10])
def test_noisy_points_are_brought_nearer_and_the_sparsest_left_out(sigma: float) -> None:
    cloud = PointCloud(lifted(lattice_sphere(), sigma))
    clean = cleaned(cloud, 1.0)
    # A share of twice the estimate is left out.
    assert len(clean.points) == round(2048 * (1 - 2 * clean.noise))
    left = np.linalg.norm(clean.points.astype(np.float64), axis=1) - RADIUS
    assert np.sqrt((left**2).mean()) < sigma / 2
    assert clean.notes[0] == f"noise: {clean.noise:.3f}"
    assert clean.notes[1].endswith(f"points, {len(clean.points)} of 2048 kept")
    assert cleaned(cloud, 0.0).noise == 0
    assert cleaned(cloud, 2.0).noise == pytest.approx(2 * clean.noise)


def test_many_points_and_far_ones() -> None:
    points = np.append(lattice_sphere(20_000), [[1e6, 0, 0]], axis=0)
    clean = cleaned(PointCloud(points), 1.0)
    assert len(clean.points) == 8192
    assert "input: 1 of 20001 points left out, they lie beyond the camera" in clean.notes
    assert "input: 8192 of 20000 points used" in clean.notes
    points[3] = np.nan
    with pytest.raises(StageFailure, match="input: 1 of 20001 points are not finite"):
        cleaned(PointCloud(points), 1.0)
