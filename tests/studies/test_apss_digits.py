from __future__ import annotations

import numpy as np

from studies.apss_digits import oriented_normals, row


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


def test_a_row_has_the_mean_of_what_is_not_moved_and_the_deviation_of_all():
    first = np.array([[1.0], [2.0], [3.0]])  # a variance of 1
    second = np.array([[3.0], [3.0], [3.0]])
    assert row([first, second]) == ["2.0000 ± 0.71"]
