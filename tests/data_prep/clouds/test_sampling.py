from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from data_prep.clouds.sampling import (
    face_areas,
    random_rows,
    random_subset,
    random_views,
    sample_surface,
)
from data_prep.failures import BadInput
from data_prep.scene import CLOUD_SIZE, Mesh, PointCloud

COUNT = 20_000
# All seeds are fixed. Were they not, each statistical test would fail once in ten thousand runs.
RARE = 1e-4
SIGMAS = stats.norm.isf(RARE / 2)  # 3.9
# Coordinates are computed in float64 and rounded once to float32: below 1, half an ulp is 2**-25.
ROUNDING = 2.0**-25


def mesh_of(triangles: object) -> Mesh:
    vertices = np.reshape(np.asarray(triangles, dtype=float), (-1, 3))
    faces = np.arange(len(vertices)).reshape(-1, 3)
    return Mesh(vertices, faces, np.zeros((len(faces), 3)))


def separate_triangles() -> tuple[Mesh, np.ndarray]:
    """Right-angled triangles, number k in the plane z = k / 32, with legs that differ a lot."""
    legs = np.array([(0.9, 0.8), (0.1, 0.1), (0.5, 0.02), (0.4, 0.4), (0.3, 0.9), (0.7, 0.2)])
    corners = [
        [[0, 0, k / 32], [a, 0, k / 32], [0, b, k / 32]] for k, (a, b) in enumerate(legs.tolist())
    ]
    return mesh_of(corners), legs.prod(axis=1) / 2


def chi_square_passes(observed: np.ndarray, shares: np.ndarray) -> None:
    expected = observed.sum() * shares / shares.sum()
    assert expected.min() > 5  # where chi-square is a fair approximation
    statistic = ((observed - expected) ** 2 / expected).sum()
    assert statistic < stats.chi2.isf(RARE, len(shares) - 1)


TRIANGLE = np.array([[0.1, -0.5, 0.3], [0.9, 0.2, -0.1], [-0.4, 0.6, 0.7]])


def barycentric(points: np.ndarray) -> np.ndarray:
    """Weights [N, 3] of TRIANGLE's corners, and assert that the points lie in its plane."""
    a, b, c = TRIANGLE
    basis = np.stack([b - a, c - a], axis=1)
    weights, *_ = np.linalg.lstsq(basis, (points - a).T)
    off = np.abs(basis @ weights - (points - a).T).max()
    assert off <= math.sqrt(3) * ROUNDING + 1e-15
    return np.stack([1 - weights.sum(axis=0), *weights], axis=1)


def test_areas_in_closed_form() -> None:
    for triangle, area in (
        ([[0, 0, 0], [3, 0, 0], [0, 4, 0]], 6.0),
        ([[1, 1, 1], [1, 1, 3], [1, 2, 1]], 1.0),
        ([[0, 0, 0], [1, 1, 1], [2, 2, 2]], 0.0),
        ([[5, 5, 5], [5, 5, 5], [5, 5, 5]], 0.0),
        ([[0, 0, 0], [2.0**-60, 0, 0], [0, 2.0**-60, 0]], 2.0**-121),
        # In float64: a leg of one float32 ulp, far from the origin, 2**-13 at 1024.
        ([[1024, 0, 0], [1024 + 2.0**-13, 0, 0], [1024, 1, 0]], 2.0**-14),
    ):
        assert face_areas(mesh_of([triangle])).tolist() == [area]


def test_cloud() -> None:
    mesh, _ = separate_triangles()
    cloud, same, other = (sample_surface(mesh, np.random.default_rng(s)) for s in (8, 8, 9))
    assert len(cloud) == CLOUD_SIZE == 2048
    assert cloud.points.dtype == np.float32
    assert cloud.source is mesh
    assert cloud.points.tobytes() == same.points.tobytes()
    assert not (cloud.points == other.points).all(axis=1).any()
    assert sample_surface(mesh, np.random.default_rng(0), 0).points.shape == (0, 3)


def test_points_lie_on_the_face() -> None:
    cloud = sample_surface(mesh_of([TRIANGLE]), np.random.default_rng(1), COUNT)
    weights = barycentric(cloud.points.astype(np.float64))
    # Rounding may carry a point over an edge by sqrt(3) half ulps; heights here are 0.9 and more.
    assert weights.min() >= -2 * ROUNDING
    assert weights.max() <= 1 + 2 * ROUNDING
    assert weights.min(axis=0).max() < 0.001  # and they reach all of its edges
    assert weights.max(axis=0).min() > 0.98  # and corners


def test_points_are_shared_out_by_area_in_any_part_of_the_rows() -> None:
    # `1024` and `512` keep each second and fourth row: the order must not follow the faces.
    mesh, areas = separate_triangles()
    points = sample_surface(mesh, np.random.default_rng(2), COUNT).points
    face = points[:, 2] * 32  # exact
    assert set(face.tolist()) <= set(range(len(areas)))
    for part in (face, face[::2], face[3::4], face[: COUNT // 2], face[COUNT // 2 :]):
        chi_square_passes(np.bincount(part.astype(int), minlength=len(areas)), areas)


def test_uniform_within_a_face() -> None:
    # Cut each side in 8: 64 congruent triangles, distinguished by the floors of the three weights.
    points = sample_surface(mesh_of([TRIANGLE]), np.random.default_rng(4), COUNT).points
    cells = np.floor(np.clip(barycentric(points.astype(np.float64)), 0, 1 - 1e-9) * 8)
    _, observed = np.unique(cells, axis=0, return_counts=True)
    assert len(observed) == 64
    chi_square_passes(observed, np.ones(64))


def test_faces_without_area_get_no_points_and_scale_does_not_matter() -> None:
    flat = [[0.5, 0.5, 0.5], [0.6, 0.6, 0.6], [0.7, 0.7, 0.7]]
    mesh = mesh_of([flat, TRIANGLE, [[0.8, 0.8, 0.8]] * 3])
    barycentric(sample_surface(mesh, np.random.default_rng(6), COUNT).points.astype(np.float64))
    for scale in (2.0**-60, 2.0**60):
        points = sample_surface(mesh_of([TRIANGLE * scale]), np.random.default_rng(7), 100).points
        barycentric(points.astype(np.float64) / scale)


@pytest.mark.parametrize(
    "triangles",
    [
        np.zeros((0, 3, 3)),
        np.zeros((2, 3, 3)),
        [[[0, 0, 0], [1, 1, 1], [2, 2, 2]]],
        [TRIANGLE, np.full((3, 3), np.nan)],
        [TRIANGLE, [[0, 0, 0], [np.inf, 1, 1], [1, 2, 3]]],
    ],
    ids=["no-faces", "points", "line", "nan", "inf"],
)
def test_surfaces_that_cannot_be_sampled(triangles: object) -> None:
    with pytest.raises(BadInput, match="no usable face"):
        sample_surface(mesh_of(triangles), np.random.default_rng(0))


def test_views_are_uniform_in_both_angles_and_reproducible() -> None:
    views = random_views(4000, np.random.default_rng(10))
    assert len(views) == 4000
    azimuth, elevation = np.array([(v.azimuth_deg, v.elevation_deg) for v in views]).T
    assert stats.kstest(azimuth, stats.uniform(-180, 360).cdf).pvalue > RARE
    assert stats.kstest(elevation, stats.uniform(-40, 80).cdf).pvalue > RARE
    # The correlation of independent samples has a standard error of 1 / sqrt(n).
    assert abs(np.corrcoef(azimuth, elevation)[0, 1]) < SIGMAS / math.sqrt(4000)
    # None outside, and the ends are reached: the chance of a gap g is (1 - g)^4000.
    gap = -math.log(RARE) / 4000
    assert -180 <= azimuth.min() < -180 + 360 * gap
    assert 180 - 360 * gap < azimuth.max() <= 180
    assert -40 <= elevation.min() < -40 + 80 * gap
    assert 40 - 80 * gap < elevation.max() <= 40
    one, same, other = (random_views(5, np.random.default_rng(s)) for s in (1, 1, 2))
    assert one == same
    assert not set(one) & set(other)
    assert all(type(angle) is float for v in one for angle in (v.azimuth_deg, v.elevation_deg))
    assert random_views(0, np.random.default_rng(1)) == ()


@pytest.mark.parametrize("count", [0, 1, 999, 1000])
def test_up_to_the_most_all_rows_are_taken(count: int) -> None:
    assert random_rows(count, 1000).tolist() == list(range(count))


@pytest.mark.parametrize(("count", "most"), [(1001, 1000), (10_000, 1), (5, 0), (3 * 2**20, 2**20)])
def test_of_more_exactly_the_most_are_taken_each_time_the_same(count: int, most: int) -> None:
    rows = random_rows(count, most)
    assert len(rows) == most
    assert (np.diff(rows) > 0).all()
    assert set(rows[[0, -1]] if most else []) <= set(range(count))
    assert np.array_equal(rows, random_rows(count, most))
    assert count == 5 or not np.array_equal(rows, random_rows(count + 1, most))


@pytest.mark.parametrize(("count", "most"), [(2**20, 2**18), (3 * 2**20 + 7, 2**20)])
def test_no_period_and_no_part_of_the_rows_is_preferred(count: int, most: int) -> None:
    """Each of 64 interleaved lasers, and of 64 parts one after the other, has its share.

    Without replacement the counts vary by 1 - most / count less than chi-square expects.
    """
    rows = random_rows(count, most)
    parts = np.linspace(0, count, 65).astype(int)
    interleaved, successive = np.bincount(rows % 64), np.histogram(rows, parts)[0]
    for found, available in (
        (interleaved, np.bincount(np.arange(count) % 64)),
        (successive, np.diff(parts)),
    ):
        expected = available * (most / count)
        statistic = ((found - expected) ** 2 / expected).sum() / (1 - most / count)
        low, high = stats.chi2.ppf([RARE / 2, 1 - RARE / 2], 63)
        assert low < statistic < high


def test_every_row_is_as_likely_as_any_other() -> None:
    """Take 50 of 101 to 600 points; half of them are of the first half."""
    firsts = sum(int((random_rows(n, 50) < n // 2).sum()) for n in range(102, 602, 2))
    draws = 250 * 50
    # A hypergeometric count varies less than a binomial one of as many draws.
    assert abs(firsts - draws / 2) < SIGMAS * math.sqrt(draws / 4)


def test_subsets_without_replacement_in_order_of_which_smaller_clouds_stay_whole() -> None:
    def subset(have: int, count: int, seed: int = 0) -> list[int]:
        cloud = PointCloud(np.arange(have)[:, None] * np.float32([1, -1, 0.5]))
        return random_subset(cloud, count, np.random.default_rng(seed)).points[:, 0].tolist()

    kept = subset(2048, 512)
    assert len(kept) == 512
    assert (np.diff(kept) > 0).all()
    assert kept != list(range(0, 2048, 4))
    for count in (0, 3, 1024):
        assert subset(count, 1024) == list(range(count))
    (one,), (other,) = (set(range(1025)) - set(subset(1025, 1024, seed)) for seed in (0, 1))
    assert one != other  # any row may be left out
