from __future__ import annotations

import numpy as np
import pytest

from baselines.reconstruction.smoothing import dense_part, smoothed
from tests.baselines.clouds import RADIUS, lattice_sphere


def saddle(points: np.ndarray) -> np.ndarray:
    """Return how far points [N, 3] lie above a saddle."""
    x, y, z = points.T
    return z - (0.3 * x * x - 0.2 * x * y - 0.1 * y * y)


def test_a_plane_stays_as_it_is() -> None:
    rng = np.random.default_rng(0)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    plane = np.column_stack([rng.uniform(-1, 1, (500, 2)), np.full(500, 0.3)]) @ turn
    np.testing.assert_allclose(smoothed(plane, 40, 3), plane, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(smoothed(lattice_sphere(), 40, 0), lattice_sphere())


def test_curved_surfaces_stay_as_they_are() -> None:
    """A fit of degree 2 errs where heights over a patch have a third derivative; over the patch's
    own plane, which is tilted by some 0.1 against the saddle's, and on spheres (their fourth)."""
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-1, 1, (2048, 2)), np.zeros(2048)])
    points[:, 2] = -saddle(points)
    # A patch of 40 has radius r = 0.16; curvature c = 0.6 tilts by c r, which turns the second
    # derivative into a third of 3 c^2 (c r), and that into a height of this times r^3 / 6.
    error = 3 * 0.6**2 * (0.6 * 0.16) * 0.16**3 / 6
    assert np.abs(saddle(smoothed(points, 40, 1))).max() < 2 * error
    # Of a sphere r = 2 R sqrt(40 / 2048) = 0.2 is the radius; the next term is r^4 / (8 R^3).
    radii = np.linalg.norm(smoothed(lattice_sphere(), 40, 1), axis=1)
    assert np.abs(radii - RADIUS).max() < 0.2**4 / (8 * RADIUS**3)


@pytest.mark.parametrize("sigma", [0.02, 0.05])
def test_noisy_points_come_nearer(sigma: float) -> None:
    """A fit of 6 numbers to n = 100 points, weighted to some 60: a deviation of sqrt(6 / 60) or a
    third of the noise is left after a round, and less after three."""
    noisy = lattice_sphere() + np.random.default_rng(0).normal(scale=sigma, size=(2048, 3))
    left = np.linalg.norm(smoothed(noisy, 100, 3), axis=1) - RADIUS
    assert np.sqrt((left**2).mean()) < sigma / 3


def test_points_of_no_surface_stay_finite() -> None:
    line = np.linspace(-1, 1, 50)[:, None] * [1.0, 0, 0]
    np.testing.assert_allclose(smoothed(line, 12, 3), line, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(smoothed(np.ones((50, 3)), 12, 3), np.ones((50, 3)))
    assert np.isfinite(smoothed(np.eye(3), 12, 2)).all()


def test_the_dense_part() -> None:
    """Points at 0, 1, 4, 9 ... lie the sparser the later; the second nearest to 0 is 1 away."""
    points = np.zeros((10, 3))
    points[:, 0] = np.arange(10) ** 2
    assert dense_part(points, 0.5, 2)[:, 0].tolist() == [0, 1, 4, 9, 16]
    assert dense_part(points[::-1], 0.5, 2)[:, 0].tolist() == [16, 9, 4, 1, 0]
    np.testing.assert_array_equal(dense_part(points, 1.0, 2), points)
