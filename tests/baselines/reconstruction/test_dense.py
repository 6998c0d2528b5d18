"""Noise of clouds with many points: known noise on surfaces with formulas."""

import numpy as np
import pytest

from baselines.reconstruction.dense import dense_noise, noise_to_remove, smoothed_subset

RADIUS = 0.8


def noisy_sphere(count: int, noise: float) -> np.ndarray:
    rng = np.random.default_rng(3)
    points = rng.normal(size=(count, 3))
    points *= RADIUS / np.linalg.norm(points, axis=1, keepdims=True)
    return (points + rng.normal(scale=noise, size=points.shape)).astype(np.float32)


def distances(points: np.ndarray) -> np.ndarray:
    """Return how far points are from the sphere, [N]."""
    return np.linalg.norm(points.astype(np.float64), axis=1) - RADIUS


@pytest.mark.parametrize("noise", [0.003, 0.01, 0.03, 0.06])
def test_noise_is_found_from_finer_than_the_spacing_to_wider_than_patches(noise):
    # The patches of the estimate are not flat: a fifth is what the page of constants allows, too.
    assert dense_noise(noisy_sphere(30_000, noise)) == pytest.approx(noise, rel=0.2)


def test_a_clean_cloud_has_nothing_to_remove_and_a_noisy_one_its_noise():
    assert noise_to_remove(noisy_sphere(30_000, 0), 30_000) == 0
    noisy = noisy_sphere(30_000, 0.02)
    assert noise_to_remove(noisy, 30_000) == dense_noise(noisy)
    # Few of these points are so far apart that the same noise is small.
    assert noise_to_remove(noisy_sphere(30_000, 0.01), 2048) == 0


@pytest.mark.parametrize("noise", [0.01, 0.04])
def test_a_subset_is_moved_to_the_surface(noise):
    points = noisy_sphere(30_000, noise)
    moved = smoothed_subset(points, noise, 4000)
    assert len(moved) == round((1 - 2 * noise) * 4000)
    # The ball around a point reaches 1.5 standard deviations, which is half of the noisy layer: a
    # fit there takes away a third to a half of the noise, and moves no point off to one side.
    assert np.std(distances(moved)) < 0.8 * noise
    assert abs(np.mean(distances(moved))) < 0.1 * noise
    # The points are spread over the whole sphere as before: no octant is empty or crowded.
    octants = np.bincount((moved > 0) @ [1, 2, 4], minlength=8)
    assert octants.min() > 0.85 * len(moved) / 8
