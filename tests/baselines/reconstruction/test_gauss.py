from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

from baselines.reconstruction.gauss import ParametricGauss, indicator, solution, surface
from data_prep.clouds.sampling import face_areas
from data_prep.failures import StageFailure
from data_prep.scene import PointCloud
from tests.baselines.clouds import RADIUS, faces_of_edges, lattice_sphere

COUNT = 1000
SPACING = RADIUS * math.sqrt(4 * math.pi / COUNT)
WIDTH = np.float32(SPACING)


@cache
def sphere() -> tuple[np.ndarray, np.ndarray]:
    samples = lattice_sphere(COUNT).astype(np.float32)
    return samples, solution(samples, WIDTH)


def chi(*places: tuple[float, float, float]) -> np.ndarray:
    return indicator(np.array(places, np.float32), *sphere(), WIDTH)


def test_the_indicator_is_half_at_the_samples_one_inside_and_nothing_outside() -> None:
    samples, vectors = sphere()
    # The raised diagonal, 5 % of one of the equations' terms, leaves a percent of the half.
    np.testing.assert_allclose(indicator(samples, samples, vectors, WIDTH), 0.5, atol=0.01)
    # By Gauss' formula chi is constant off the surface: where a sum over samples stands for the
    # integral, up to exp(-2 pi distance / spacing), which is nothing here; the level is off by as
    # much as above, and by the kernel's cut at `width`.
    np.testing.assert_allclose(chi((0, 0, 0), (0.3, 0, 0), (0, -0.4, 0.1)), 1, atol=0.05)
    np.testing.assert_allclose(chi((1, 0, 0), (0, 1.2, 0), (2, 2, 2)), 0, atol=0.001)


def test_the_vectors_are_areas_times_normals() -> None:
    samples, vectors = sphere()
    total = (vectors * samples / RADIUS).sum()
    # chi inside is flux over 4 pi r^2: the same deviation as above.
    assert abs(total) == pytest.approx(4 * math.pi * RADIUS**2, rel=0.05)


def test_the_equations() -> None:
    """An independent dense solution with A written out, in float64."""
    samples = np.random.default_rng(0).uniform(-1, 1, (30, 3))
    offset = samples[:, None] - samples
    r = np.maximum(np.linalg.norm(offset, axis=2), 0.2)
    a = (offset / (4 * np.pi * r[..., None] ** 3)).reshape(30, 90)
    gram = a @ a.T
    gram += 0.05 * np.diag(np.diag(gram))
    expected = (a.T @ np.linalg.solve(gram, np.full(30, 0.5))).reshape(30, 3)
    actual = solution(samples.astype(np.float32), np.float32(0.2))
    # float32 has 1e-7; the condition of a Gram matrix with 5 % more on its diagonal is some 1e3.
    np.testing.assert_allclose(actual, expected, atol=1e-3 * np.abs(expected).max())


def test_a_sphere() -> None:
    mesh = surface(*sphere(), WIDTH, reach=0.1, cell=0.03)
    radii = np.linalg.norm(mesh.vertices.astype(np.float64), axis=1)
    # The level passes the samples; between them chi waves with the spacing, by less than a tenth.
    assert np.abs(radii - RADIUS).max() < SPACING / 10
    assert (faces_of_edges(mesh.faces) == 2).all()
    assert face_areas(mesh).sum() == pytest.approx(4 * math.pi * RADIUS**2, rel=0.01)
    corners = mesh.vertices[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert ((normals * corners[:, 0]).sum(axis=1) > 0).all()


def test_large_clouds_are_thinned() -> None:
    state = ParametricGauss().prepare(PointCloud(lattice_sphere(20_000)))
    assert "input: 2500 of 20000 points used" in state.notes
    radii = np.linalg.norm(state.mesh.vertices.astype(np.float64), axis=1)
    assert radii.mean() == pytest.approx(RADIUS, abs=0.01)


def test_points_too_near_each_other_are_named() -> None:
    with pytest.raises(StageFailure, match=r"gauss: .* no (finite )?solution"):
        ParametricGauss().prepare(PointCloud(1e-30 * lattice_sphere(100)))
