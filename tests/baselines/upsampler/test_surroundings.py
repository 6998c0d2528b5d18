from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from baselines.reconstruction.denoised import noise_scale
from baselines.reconstruction.stages import Nearest, spacing
from baselines.upsampler.surroundings import RANKS, places_around, surroundings
from tests.baselines.clouds import RADIUS, lattice_sphere


def square(count: int = 400) -> np.ndarray:
    points = np.random.default_rng(0).uniform(-1, 1, (count, 3)) * [1, 1, 0]
    return points.astype(np.float32)


def test_normals_are_those_of_a_square_and_the_unit_is_its_spacing() -> None:
    points = square()
    seen, notes = surroundings(points)
    assert notes == ()
    np.testing.assert_array_equal(seen.points.numpy(), points)
    assert torch.equal(seen.raw, seen.points)
    assert torch.equal(seen.raw_normals, seen.normals)
    torch.testing.assert_close(seen.normals.abs(), torch.eye(3)[2].expand(400, 3))
    assert np.median(seen.radius) == pytest.approx(spacing(Nearest(points)), rel=1e-6)
    distance = np.linalg.norm(points[:, None] - points[None], axis=2)
    order = np.argsort(distance, axis=1)[:, list(RANKS)]
    np.testing.assert_array_equal(seen.neighbours.numpy(), order)


def test_noisy_points_are_smoothed_and_the_network_is_told() -> None:
    clean = lattice_sphere()
    noisy = clean + np.random.default_rng(0).normal(size=clean.shape) * 0.05
    seen, (noise, smoothed) = surroundings(noisy.astype(np.float32))
    assert noise.startswith("noise: 0.0")
    assert smoothed.startswith("smoothed: over ")
    estimate = (seen.noise * seen.radius).numpy()
    expected = noise_scale(Nearest(noisy.astype(np.float32)))
    np.testing.assert_allclose(estimate, expected, rtol=1e-6)
    np.testing.assert_array_equal(seen.raw, noisy.astype(np.float32))
    rough, smooth = (
        np.linalg.norm(points, axis=1) - RADIUS for points in (noisy, seen.points.numpy())
    )
    assert smooth.std() < rough.std() / 3


@pytest.mark.parametrize("count", [2, 5, 20])
def test_of_few_points_the_farthest_stand_for_those_that_there_are_not(count: int) -> None:
    points = square(count)
    seen, _ = surroundings(points)
    assert seen.neighbours.shape == (count, len(RANKS))
    assert (seen.radius > 0).all()
    assert set(seen.neighbours[0].tolist()) <= set(range(1, count))
    for tensor in (seen.points, seen.normals, seen.noise):
        assert tensor.isfinite().all()


def test_places_turn_with_the_cloud_whatever_the_signs_of_normals() -> None:
    points = lattice_sphere(200) + np.random.default_rng(0).normal(size=(200, 3)) * 0.01
    turn = Rotation.from_euler("xyz", (0.3, 1.0, -2.0)).as_matrix()
    places, turned = (
        places_around(surroundings(cloud.astype(np.float32))[0], 5).numpy()
        for cloud in (points, points @ turn.T)
    )
    # A spacing of .15 in float32, after a difference from neighbours as near as a tenth of it.
    np.testing.assert_allclose(turned, places @ turn.T, rtol=0, atol=1e-5)


def test_places_fill_discs_of_a_spacing_in_the_plane_of_each_point() -> None:
    seen, _ = surroundings(square())
    places = places_around(seen, 16).view(400, 16, 3)
    assert torch.equal(places[:, 0], seen.points)
    offset = (places - seen.points[:, None]) / seen.radius[:, None, None]
    assert not offset[..., 2].any()
    # rings of equal area of a disc with the radius 1, by their inner edge
    expected = torch.sqrt(torch.arange(16) / 16).expand(400, 16)
    torch.testing.assert_close(offset.norm(dim=2), expected, rtol=1e-4, atol=1e-5)
    assert offset.mean(dim=1).norm(dim=1).max() < 0.15  # to all sides
