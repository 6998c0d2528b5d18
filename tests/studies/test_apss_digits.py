from __future__ import annotations

import numpy as np
import pytest

from studies.apss_digits import Chain, oriented_normals, row


def sphere(count: int) -> np.ndarray:
    """Return points that are spread evenly, by the golden angle."""
    z = 1 - (2 * np.arange(count) + 1) / count
    angle = np.pi * (3 - np.sqrt(5)) * np.arange(count)
    ring = np.sqrt(1 - z**2)
    points = np.stack([ring * np.cos(angle), ring * np.sin(angle), z], axis=1)
    return points.astype(np.float32)


def test_normals_of_a_sphere_all_point_outwards():
    """A patch of ten neighbours among 500 spans some 20 degrees, and its plane is tangent."""
    points = sphere(500)
    cosines = np.sum(oriented_normals(points) * points, axis=1)
    assert cosines.min() > np.cos(np.radians(10))


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_numbers_are_moved_by_one_rounding_error_at_their_stage_only(dtype):
    chain = Chain("normals", "none")
    values = np.random.default_rng(0).normal(size=(1000, 3)).astype(dtype)
    assert chain._moved("points", values, np.random.default_rng(1)) is values
    assert chain._moved("normals", values, None) is values
    moved = chain._moved("normals", values, np.random.default_rng(1))
    assert moved.dtype == dtype
    steps = np.stack([np.nextafter(values, values.dtype.type(end)) for end in (-np.inf, np.inf)])
    kinds = [moved == values, moved == steps[0], moved == steps[1]]
    assert np.all(np.sum(kinds, axis=0) == 1)
    # a third each of 3,000: the deviation of a share is 0.0086
    assert np.abs(np.mean(kinds, axis=(1, 2)) - 1 / 3).max() < 0.035


def test_changes_of_the_points():
    points = np.float32([(0.5, 0, 0.25), (0.5, 1e-6, 0.25), (0, 0, 0), (1, 1, 1), (0.3, 0, 1)])
    assert np.array_equal(Chain("points", "none")._changed(points), points)
    assert Chain("points", "sorted")._changed(points)[:, 2].tolist() == [0, 0.25, 0.25, 1, 1]
    snapped = Chain("points", "snapped")._changed(points)
    assert (snapped * 4096 % 1 == 0).all()
    assert np.abs(snapped - points).max() <= 2**-13
    spaced = Chain("points", "spaced")._changed(points)
    assert spaced.tolist() == np.delete(points, 1, axis=0).tolist()


def test_a_row_has_the_mean_of_what_is_not_moved_and_the_deviation_of_all():
    first = np.array([[1.0], [2.0], [3.0]])  # a variance of 1
    second = np.array([[3.0], [3.0], [3.0]])
    assert row([first, second]) == ["2.0000 ± 0.71"]
