"""The paper's chain, without its last stage, and on coarser cells; and what goes wrong in it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from baselines.reconstruction.meshlab import MeshLab
from baselines.reconstruction.poisson import Poisson
from baselines.reconstruction.stages import FOOTPRINT, finite_part
from baselines.reconstruction.surface import SurfaceApss, SurfaceBpa
from baselines.reconstruction.surface_fit import SurfaceFit, one_a_cube, resolution
from data_prep.clouds.sampling import face_areas
from data_prep.failures import StageFailure
from data_prep.rendering.camera import project
from data_prep.scene import NEUTRAL_GREY, Mesh, PointCloud, View
from tests.baselines.clouds import RADIUS, chair_cloud, faces_of_edges, lattice_sphere

# The chain looks at a neighbourhood of filter scale 2 times the local point spacing, which MeshLab
# estimates from the 16 nearest points (a cap of area 16 / 2048, radius 2 r sqrt(16 / 2048) = 0.124)
# as 2 * 0.124 / sqrt(16) = 0.062. A fit that knew nothing of curvature would be off by the sag of
# such a neighbourhood, 0.124^2 / (2 r).
SAG = (2 * 0.062) ** 2 / (2 * RADIUS)  # 0.011


def test_evenly_sampled_sphere() -> None:
    ball = SurfaceApss(resolution=100).prepare(PointCloud(lattice_sphere()))
    # Spheres are what APSS fits (spherical parameter 1): even normals leave a tenth of the sag.
    error = np.linalg.norm(ball.mesh.vertices.astype(np.float64), axis=1) - RADIUS
    assert np.abs(error).max() < SAG / 10
    assert ball.notes == ()
    assert (ball.mesh.face_colors == NEUTRAL_GREY).all()
    assert (faces_of_edges(ball.mesh.faces) == 2).all()
    coarse = SurfaceApss(resolution=50).prepare(PointCloud(lattice_sphere())).mesh
    # A surface crosses a number of cells that grows with the square of the resolution; where the
    # grid begins and ends is a cell or two of a hundred.
    assert len(ball.mesh.faces) / len(coarse.faces) == pytest.approx(4, rel=0.04)


@pytest.mark.parametrize("side", [0.01, 0.1])
def test_the_radius_is_a_share_of_the_diagonal(side: float) -> None:
    # Equilateral triangles: a ball smaller than their circumcircle, side / sqrt 3, falls through.
    row, column = np.mgrid[:15, :15]
    points = np.stack([column + 0.5 * (row % 2), row * 3**0.5 / 2, np.zeros_like(row)], axis=-1)
    cloud = PointCloud(side * points.reshape(-1, 3))
    least = 100 / 3**0.5 / np.hypot(14.5, 14 * 3**0.5 / 2)
    for radius_percent in (1.03 * least, 1.4 * least):
        state = SurfaceBpa(radius_percent).prepare(cloud)
        assert len(state.mesh.faces) >= 2 * 14**2  # all triangles; gaps along the edge closed
    with pytest.raises(StageFailure, match="ball-pivoting: no faces"):
        SurfaceBpa(radius_percent=0.97 * least).prepare(cloud)


def refuses(*_args, **_options) -> None:
    raise RuntimeError("MeshLab says no")


def empties(meshlab: MeshLab, *_args, **_options) -> None:
    meshlab.__init__(lattice_sphere(20))


METHODS = {
    "marching_cubes_apss": ("apss", SurfaceApss(), SurfaceFit(1.0)),
    "screened_poisson": ("poisson", Poisson()),
}
BEFORE = {
    "estimate_normals": "normals",
    "ball_pivoting": "ball-pivoting",
    "close_holes": "close-holes",
}


@pytest.mark.parametrize("last", METHODS)
@pytest.mark.parametrize("broken", [*BEFORE, ""])
def test_a_stage_that_raises_or_leaves_no_faces_is_named(
    monkeypatch: pytest.MonkeyPatch, last: str, broken: str
) -> None:
    stage, *methods = METHODS[last]
    for effect, problem in ((refuses, "MeshLab says no"), (empties, "no faces")):
        monkeypatch.setattr(MeshLab, broken or last, effect)
        if (broken, effect) == ("estimate_normals", empties):
            monkeypatch.setattr(MeshLab, "normals", lambda _: np.array([[0, np.nan, 0]]))
            problem = "a normal is not finite"
        for method in methods:
            with pytest.raises(StageFailure) as failure:
                method.prepare(PointCloud(lattice_sphere(50)))
            assert failure.value.stage == BEFORE.get(broken, stage)
            assert failure.value.problem == problem


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_exactly_the_faces_of_vertices_that_are_not_finite_are_dropped(value: float) -> None:
    vertices = np.random.default_rng(0).normal(size=(7, 3))
    vertices[4, 2] = value
    faces = [[0, 1, 2], [2, 3, 4], [0, 2, 3], [4, 5, 6], [3, 5, 6]]
    colors = np.arange(15).reshape(5, 3)
    result = finite_part("apss", Mesh(vertices, faces, colors))
    assert result.mesh.faces.tolist() == [faces[i] for i in (0, 2, 4)]
    assert result.mesh.face_colors.tolist() == [colors[i].tolist() for i in (0, 2, 4)]
    kept = [0, 1, 2, 3, 5, 6]
    np.testing.assert_array_equal(result.mesh.vertices[kept], np.float32(vertices[kept]))
    assert np.isfinite(result.mesh.vertices).all()
    assert result.notes == ("apss: 2 of 5 faces dropped, a vertex is not finite",)
    assert finite_part("apss", Mesh(vertices, faces[:1], colors[:1])).notes == ()
    with pytest.raises(StageFailure, match="apss: none of 1 faces has finite vertices"):
        finite_part("apss", Mesh(vertices, faces[1:2], colors[1:2]))


def test_a_footprint_is_a_pixel_at_the_origin() -> None:
    pixels, _ = project(np.array([[0.0, 0, 0], [0, FOOTPRINT, 0]]), View(0, 0))
    np.testing.assert_allclose(pixels[0] - pixels[1], [0, 1], rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("longest", "cell", "expected"),
    [
        (1.0, 0.099, 12),  # 1.2 / 0.099 = 12.1
        (1.0, 0.121, 9),
        (40.0, 0.1, 200),  # never finer than the paper's
        (0.01, 0.1, 1),
        (0.0, 0.1, 1),
    ],
)
def test_resolution(longest: float, cell: float, expected: int) -> None:
    corners = np.array([[0, 0, 0], [longest, longest / 2, -longest / 3]])
    assert resolution(corners - 3, cell) == expected


@pytest.mark.parametrize("side", [0.05, 0.3, 10.0])
def test_each_cube_keeps_the_point_nearest_its_middle(side: float) -> None:
    points = np.random.default_rng(0).normal(size=(400, 3)).astype(np.float32)
    best: dict[tuple[int, ...], tuple[float, int]] = {}
    for i, point in enumerate(points.astype(np.float64)):
        place = tuple(math.floor(x / side) for x in point)
        off = sum((x / side - k - 0.5) ** 2 for x, k in zip(point, place, strict=True))
        best[place] = min(best.get(place, (math.inf, -1)), (off, i))
    kept = one_a_cube(points, side)
    assert len(kept) == len(best)
    assert {tuple(point) for point in kept} == {tuple(points[i]) for _, i in best.values()}


def test_of_equally_near_points_coordinates_decide() -> None:
    # The lattice lies evenly about the middle of each cube: eight points are equally near to it.
    points = np.stack(np.meshgrid(*3 * [np.arange(-4, 4) / 8 + 1 / 16]), axis=-1).reshape(-1, 3)
    points = points.astype(np.float32)
    kept = one_a_cube(points, 0.5)
    assert len(kept) == 8
    shuffled = np.random.default_rng(0).permutation(points)
    np.testing.assert_array_equal(one_a_cube(shuffled, 0.5), kept)
    np.testing.assert_array_equal(one_a_cube(kept, 0.5), kept)


# untouched, and 14 times as dense as is of use
@pytest.mark.parametrize(("count", "cell_px"), [(2048, 2.25), (30_000, 2.25), (2048, 1.5)])
def test_sphere_of_any_density(count: int, cell_px: float) -> None:
    cloud = PointCloud(lattice_sphere(count))
    mesh = (SurfaceFit() if cell_px == 2.25 else SurfaceFit(cell_px)).prepare(cloud).mesh
    # APSS alone leaves a tenth of the sag of its neighbourhood, 0.001; the points that are kept are
    # less even. Nothing is off by what a pixel shows.
    error = np.abs(np.linalg.norm(mesh.vertices.astype(np.float64), axis=1) - RADIUS)
    assert np.quantile(error, 0.99) < 2e-3
    assert error.max() < FOOTPRINT / 2
    # Facets inscribed in a sphere lose some (cell / r)^2 / 8 = 0.04 % of its area; a hole of one
    # cell would be 0.02 %, and a seam or a domain narrower than the cells many of them.
    assert face_areas(mesh).sum() == pytest.approx(4 * math.pi * RADIUS**2, rel=0.003)
    # Marching cubes give about 3.1 facets (mean over directions) a cell's face of surface.
    expected = 3.1 * 4 * math.pi * RADIUS**2 / (cell_px * FOOTPRINT) ** 2
    assert len(mesh.faces) == pytest.approx(expected, rel=0.15)


def test_far_outliers_are_noted_and_change_nothing() -> None:
    points = chair_cloud().points
    outliers = np.array([[5.0, 0, 0], [0, -1e30, 0]], np.float32)
    plain, noted = (
        SurfaceFit().prepare(PointCloud(some))
        for some in (points, np.append(points, outliers, axis=0))
    )
    np.testing.assert_array_equal(plain.mesh.vertices, noted.mesh.vertices)
    np.testing.assert_array_equal(plain.mesh.faces, noted.mesh.faces)
    assert plain.notes == ()
    assert noted.notes == ("input: 2 of 2050 points left out, they lie beyond the camera",)
