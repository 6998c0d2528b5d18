from __future__ import annotations

import numpy as np
import pytest

from data_prep.clouds.sorting import different_points, repeats, sorted_points

GENERAL = np.random.default_rng(0).standard_normal((3000, 3)).astype(np.float32)
CLOUDS = {
    "general": GENERAL,
    "coarse steps, many coincide": np.round(4 * GENERAL),
    "a plane across x": GENERAL * np.array([0, 1, 1], np.float32),
    "a line along z": np.round(4 * GENERAL) * np.array([0, 0, 1], np.float32),
    "each twice": np.repeat(GENERAL, 2, axis=0),
    "all coincide": np.zeros((5, 3), np.float32),
    "two share their x": np.array([[1, 0, 5], [0, 9, 9], [1, 0, 4]], np.float32),
    "float64": GENERAL.astype(np.float64) + 1e-9,
    "one": GENERAL[:1],
    "none": GENERAL[:0],
}


@pytest.mark.parametrize("name", CLOUDS)
def test_points_are_sorted_by_all_coordinates_and_kept_once(name: str) -> None:
    points = CLOUDS[name]
    before = points.copy()
    ordered, different = sorted_points(points), different_points(points)
    assert ordered.tolist() == sorted(points.tolist())
    assert list(map(tuple, different.tolist())) == sorted(set(map(tuple, points.tolist())))
    assert ordered.dtype == different.dtype == points.dtype
    assert np.count_nonzero(repeats(ordered)) == len(points) - len(different)
    assert np.array_equal(points, before)
