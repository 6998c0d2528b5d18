"""The paper's chain as a whole, without its last stage (`surface-bpa`), and what goes wrong."""

from __future__ import annotations

import numpy as np
import pytest

from baselines.reconstruction import surface
from baselines.reconstruction.poisson import Poisson
from baselines.reconstruction.surface import SurfaceApss, SurfaceBpa, closed_surface
from baselines.reconstruction.surface_fit import SurfaceFit
from data_prep.failures import StageFailure
from data_prep.scene import NEUTRAL_GREY, Mesh, PointCloud
from tests.baselines.clouds import RADIUS, chair_cloud, faces_of_edges, lattice_sphere


def random_sphere(count: int) -> PointCloud:
    points = np.random.default_rng(0).normal(size=(count, 3))
    return PointCloud(RADIUS * points / np.linalg.norm(points, axis=1, keepdims=True))


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


def test_surface_bpa_is_the_chain_up_to_its_third_stage() -> None:
    cloud = chair_cloud()
    state = SurfaceBpa().prepare(cloud)
    expected = closed_surface(cloud.points).mesh(NEUTRAL_GREY)
    np.testing.assert_array_equal(state.mesh.faces, expected.faces)
    np.testing.assert_array_equal(state.mesh.vertices, cloud.points)  # none is made or moved
    assert state.notes == ()


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
    with pytest.raises(StageFailure, match="no faces") as failure:
        SurfaceBpa(radius_percent=0.97 * least).prepare(cloud)
    assert failure.value.stage == "ball-pivoting"


class FakeMeshLab:
    """Stands for MeshLab."""

    log: tuple[str, ...] = ()
    options: tuple[float, ...] = ()  # of APSS
    normal = 1.0
    raises = ""  # the stage that raises
    empties = ""  # the stage that leaves no faces
    result = Mesh(np.eye(3), [[0, 1, 2]], [NEUTRAL_GREY])

    def __init__(self, points: np.ndarray) -> None:
        self.face_count = 0
        type(self).log = ()

    def _stage(self, name: str, faces: int) -> None:
        type(self).log += (name,)
        if self.raises == name:
            raise RuntimeError("MeshLab says no")
        self.face_count = 0 if self.empties == name else faces

    def estimate_normals(self, neighbours: int) -> None:
        self._stage(f"normals {neighbours}", 0)

    def ball_pivoting(self, radius_percent: float | None) -> None:
        assert radius_percent is None
        self._stage("ball-pivoting", 1)

    def close_holes(self, max_edges: int) -> None:
        self._stage(f"close-holes {max_edges}", 1)

    def marching_cubes_apss(self, resolution: int, *options: float, **flags: bool) -> None:
        type(self).options = (*options, *flags.values())
        self._stage(f"apss {resolution}", 1)

    def screened_poisson(self, depth: int) -> None:
        self._stage(f"poisson {depth}", 1)

    def normals(self) -> np.ndarray:
        return np.array([[0.0, self.normal, 0.0]])

    def mesh(self, color: tuple[int, int, int]) -> Mesh:
        assert color == NEUTRAL_GREY
        return self.result


STAGES = ("normals 10", "ball-pivoting", "close-holes 30", "apss 200")
CLOUD = random_sphere(50)


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch) -> type[FakeMeshLab]:
    class Fake(FakeMeshLab):
        pass

    monkeypatch.setattr(surface, "MeshLab", Fake)
    return Fake


def refusal(method, cloud: PointCloud = CLOUD) -> tuple[str, str]:
    with pytest.raises(StageFailure) as failure:
        method.prepare(cloud)
    return failure.value.stage, failure.value.problem


def test_stages_in_order_with_the_papers_parameters(fake: type[FakeMeshLab]) -> None:
    result = SurfaceApss().prepare(CLOUD)
    assert fake.log == STAGES
    assert result.mesh is fake.result  # finite: untouched
    assert result.notes == ()
    assert fake.options == ()
    SurfaceApss(resolution=77).prepare(CLOUD)
    assert fake.log == (*STAGES[:3], "apss 77")
    SurfaceFit(1.0).prepare(CLOUD)
    assert fake.options == (0.0, False)  # always 15 steps: nothing is read that nobody has written


METHODS = {
    "apss 200": SurfaceApss(),
    "poisson 7": Poisson(),
    "apss 94": SurfaceFit(1.0),  # 1.2 x 1.36 units over a pixel at the origin
}


@pytest.mark.parametrize("last", METHODS)
@pytest.mark.parametrize("number", range(4))
def test_a_stage_that_raises_or_leaves_no_faces_is_named(
    fake: type[FakeMeshLab], last: str, number: int
) -> None:
    stages = (*STAGES[:3], last)
    method, name = METHODS[last], stages[number].split()[0]
    fake.raises = stages[number]
    assert refusal(method) == (name, "MeshLab says no")
    assert fake.log == stages[: number + 1]
    fake.raises, fake.empties = "", stages[number]
    if number > 0:
        assert refusal(method) == (name, "no faces")
        assert fake.log == stages[: number + 1]  # nothing runs on nothing


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_exactly_the_faces_of_vertices_that_are_not_finite_are_dropped(
    fake: type[FakeMeshLab], value: float
) -> None:
    vertices = np.random.default_rng(0).normal(size=(7, 3))
    vertices[4, 2] = value
    faces = [[0, 1, 2], [2, 3, 4], [0, 2, 3], [4, 5, 6], [3, 5, 6], [6, 4, 0]]
    colors = np.arange(18).reshape(6, 3)
    fake.result = Mesh(vertices, faces, colors)
    result = SurfaceApss().prepare(CLOUD)
    assert result.mesh.faces.tolist() == [faces[i] for i in (0, 2, 4)]
    assert result.mesh.face_colors.tolist() == [colors[i].tolist() for i in (0, 2, 4)]
    kept = [0, 1, 2, 3, 5, 6]
    np.testing.assert_array_equal(result.mesh.vertices[kept], np.float32(vertices[kept]))
    assert np.isfinite(result.mesh.vertices).all()
    assert result.notes == ("apss: 3 of 6 faces dropped, a vertex is not finite",)
    fake.result = Mesh(vertices, faces[:1], colors[:1])
    assert SurfaceApss().prepare(CLOUD).notes == ()  # no face has that vertex
    fake.result = Mesh(vertices, faces[1:2], colors[1:2])
    assert refusal(SurfaceApss()) == ("apss", "no face with finite vertices")


def test_what_is_refused_before_and_after_the_normals(fake: type[FakeMeshLab]) -> None:
    for count in (0, 10):
        expected = ("input", f"{count} points; normals need at least 11")
        assert refusal(SurfaceApss(), random_sphere(count)) == expected
    for value in (np.nan, np.inf, -np.inf):  # MeshLab would never return from such a cloud
        points = CLOUD.points.copy()
        points[17, 1] = points[30, 0] = points[30, 2] = value
        expected = ("input", "2 of 50 points are not finite")
        assert refusal(SurfaceApss(), PointCloud(points)) == expected
    assert fake.log == ()
    SurfaceApss().prepare(random_sphere(11))
    fake.normal = np.nan
    assert refusal(SurfaceApss()) == ("normals", "a normal is not finite")
    assert fake.log == STAGES[:1]
