from __future__ import annotations

import numpy as np
import pytest

from baselines.reconstruction.denoised import cleaned
from data_prep.failures import StageFailure
from data_prep.scene import PointCloud
from tests.baselines.clouds import RADIUS, chair_cloud, lattice_sphere


def noisy(points: np.ndarray, sigma: float) -> PointCloud:
    return PointCloud(points + np.random.default_rng(0).normal(scale=sigma, size=points.shape))


@pytest.mark.parametrize("count", [512, 1024, 2048])
def test_clean_points_stay_as_they_are(count: int) -> None:
    cloud = chair_cloud(count)
    clean = cleaned(cloud, 1.0)
    assert clean.noise == 0
    np.testing.assert_array_equal(clean.points, np.unique(cloud.points, axis=0))
    assert clean.points.dtype == np.float32
    (note,) = clean.notes
    assert note.startswith("noise: 0.0")


@pytest.mark.parametrize("sigma", [0.05, 0.10])
def test_noisy_points_are_brought_nearer_and_the_sparsest_left_out(sigma: float) -> None:
    clean = cleaned(noisy(lattice_sphere(), sigma), 1.0)
    assert clean.noise > 0.8 * sigma  # see test_noise
    # A share of twice the estimate is left out.
    assert len(clean.points) == round(2048 * (1 - 2 * clean.noise))
    left = np.linalg.norm(clean.points.astype(np.float64), axis=1) - RADIUS
    assert np.sqrt((left**2).mean()) < sigma / 2  # see test_smoothing
    assert clean.notes[0] == f"noise: {clean.noise:.3f}"
    assert clean.notes[1].endswith(f"points, {len(clean.points)} of 2048 kept")


def test_strength() -> None:
    cloud = noisy(lattice_sphere(), 0.05)
    assert cleaned(cloud, 0.0).noise == 0
    assert cleaned(cloud, 2.0).noise == pytest.approx(2 * cleaned(cloud, 1.0).noise)


def test_many_points_and_far_ones() -> None:
    points = np.append(lattice_sphere(20_000), [[1e6, 0, 0]], axis=0)
    clean = cleaned(PointCloud(points), 1.0)
    assert len(clean.points) == 6667  # every third
    assert "input: 1 of 20001 points left out, they lie beyond the camera" in clean.notes
    assert "input: 6667 of 20000 points used" in clean.notes


def test_too_few_different_points() -> None:
    with pytest.raises(StageFailure, match="input: 10 of 50 points are different and nearer"):
        cleaned(PointCloud(np.repeat(lattice_sphere(10), 5, axis=0)), 1.0)
