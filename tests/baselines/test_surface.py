from __future__ import annotations

import json
import math
import subprocess
import sys

import numpy as np
import pytest

from baselines import surface
from baselines.surface import Reconstruction, SurfaceApss
from data_prep.failures import StageFailure
from data_prep.mesh_files import NEUTRAL_GREY
from data_prep.render import render
from data_prep.scene import Mesh, PointCloud, View

from .clouds import RADIUS, lattice_sphere


def random_sphere(count: int = 2048, seed: int = 0) -> PointCloud:
    points = np.random.default_rng(seed).normal(size=(count, 3))
    return PointCloud(RADIUS * points / np.linalg.norm(points, axis=1, keepdims=True))


# --- a sphere in closed form ----------------------------------------------------------------------

# The chain looks at a neighbourhood of filter scale 2 times the local point spacing, which MeshLab
# estimates from the 16 nearest points (a cap of area 16 / 2048, radius 2 r sqrt(16 / 2048) = 0.124)
# as 2 * 0.124 / sqrt(16) = 0.062. A fit that knew nothing of curvature would be off by the sag of
# such a neighbourhood, 0.124^2 / (2 r).
SAG = (2 * 0.062) ** 2 / (2 * RADIUS)  # 0.011


@pytest.fixture(scope="module")
def ball() -> Reconstruction:
    return SurfaceApss(resolution=100).prepare(PointCloud(lattice_sphere()))


def test_evenly_sampled_sphere(ball: Reconstruction) -> None:
    # Spheres are what APSS fits (spherical parameter 1): even normals leave a tenth of the sag.
    error = np.linalg.norm(ball.mesh.vertices.astype(np.float64), axis=1) - RADIUS
    assert np.abs(error).max() < SAG / 10
    assert ball.notes == ()
    assert (ball.mesh.face_colors == NEUTRAL_GREY).all()


def test_the_sphere_is_closed(ball: Reconstruction) -> None:
    corners = ball.mesh.vertices.astype(np.float64)[ball.mesh.faces]
    volume = np.abs((corners[:, 0] * np.cross(corners[:, 1], corners[:, 2])).sum() / 6)
    # A closed surface within e of the sphere encloses its volume within 3 e / r; one with a hole
    # misses the cone above it.
    exact = 4 / 3 * math.pi * RADIUS**3
    assert volume == pytest.approx(exact, rel=3 * SAG / 10 / RADIUS)
    edges = np.sort(ball.mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()


@pytest.mark.parametrize("view", [View(0, 0), View(50, -30)], ids=str)
def test_image_of_the_sphere(ball: Reconstruction, view: View) -> None:
    image = SurfaceApss().draw(ball, [view])[0]
    radius = 232 * RADIUS / math.sqrt(4**2 - RADIUS**2)  # 41.2 px
    row, column = np.mgrid[:128, :128] + 0.5
    distance = np.hypot(row - 64, column - 64)
    # The surface's error is SAG / 10 * 232 / 4 = 0.06 px; a pixel reaches 0.71 beyond its centre.
    assert (image[distance > radius + 0.8] == 1).all()
    assert (image[distance < radius - 0.8] < 1).all()
    # Black on white tells covered shares: sqrt(area / pi), see the unit sphere in test_render.
    black = Mesh(ball.mesh.vertices, ball.mesh.faces, np.zeros_like(ball.mesh.face_colors))
    area = (1 - render(black, [view])[0, ..., 0] / 255.0).sum()
    assert math.sqrt(area / math.pi) == pytest.approx(radius, abs=0.06 + 0.03)
    # Lambert's law on the grey of 180: at u of the silhouette's radius the ray meets the sphere
    # where the normal's component towards the camera is c. Facets err by their own tilt; a median
    # over a ring of hundreds is within a level.
    for u in (0.0, 0.3, 0.6, 0.9):
        slope = u * radius / 232
        depth = (4 - math.sqrt(16 - (1 + slope**2) * (16 - RADIUS**2))) / (1 + slope**2)
        cosine = (4 - depth) / RADIUS
        ring = image[np.abs(distance - u * radius) < 1.5]
        expected = 180 / 255 * cosine ** (1 / 2.2)
        assert np.median(ring) == pytest.approx(expected, abs=1.5 / 255), u


def test_randomly_sampled_sphere() -> None:
    # Uneven neighbourhoods tilt the normals, and some places go wrong; the bulk stays within the
    # sag, and the error has no direction.
    mesh = SurfaceApss(resolution=100).prepare(random_sphere()).mesh
    error = np.linalg.norm(mesh.vertices.astype(np.float64), axis=1) - RADIUS
    assert np.quantile(np.abs(error), 0.99) < SAG
    assert np.abs(np.median(error)) < SAG / 10


@pytest.mark.parametrize("scale", [2.0**-20, 2.0**20])
def test_scale_does_not_matter(scale: float) -> None:
    # A power of two changes no digit of the coordinates; float32 and MeshLab's own constants do
    # the rest, at most a grid cell's share of the sag.
    plain, scaled = (
        SurfaceApss(resolution=30).prepare(PointCloud(lattice_sphere() * s)).mesh
        for s in (1.0, scale)
    )
    radius = np.linalg.norm(scaled.vertices.astype(np.float64), axis=1) / scale
    assert np.abs(radius - RADIUS).max() < SAG / 10
    assert len(scaled.faces) == len(plain.faces)


def test_a_finer_grid_gives_more_faces(ball: Reconstruction) -> None:
    coarse = SurfaceApss(resolution=50).prepare(PointCloud(lattice_sphere())).mesh
    # A surface crosses a number of cells that grows with the square of the resolution; where the
    # grid begins and ends is a cell or two of a hundred.
    assert len(ball.mesh.faces) / len(coarse.faces) == pytest.approx(4, rel=0.04)


# --- vertices that are not finite -----------------------------------------------------------------


class FakeMeshLab:
    """Stands for MeshLab where its stages have to go wrong on cue."""

    log: tuple[str, ...] = ()
    bad_normal = False
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

    def marching_cubes_apss(self, resolution: int) -> None:
        self._stage(f"apss {resolution}", 1)

    def normals(self) -> np.ndarray:
        return np.array([[0.0, np.nan if self.bad_normal else 1.0, 0.0]])

    def mesh(self, color: tuple[int, int, int]) -> Mesh:
        assert color == NEUTRAL_GREY
        return self.result


STAGES = ("normals 10", "ball-pivoting", "close-holes 30", "apss 200")


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch) -> type[FakeMeshLab]:
    class Fake(FakeMeshLab):
        pass

    monkeypatch.setattr(surface, "MeshLab", Fake)
    return Fake


def faces_of(count: int) -> np.ndarray:
    return np.arange(3 * count).reshape(count, 3)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_exactly_the_faces_of_such_vertices_are_dropped(
    fake: type[FakeMeshLab], value: float
) -> None:
    vertices = np.random.default_rng(0).normal(size=(7, 3))
    vertices[4, 2] = value
    faces = [[0, 1, 2], [2, 3, 4], [0, 2, 3], [4, 5, 6], [3, 5, 6], [6, 4, 0]]
    colors = np.arange(18).reshape(6, 3)
    fake.result = Mesh(vertices, faces, colors)
    result = SurfaceApss().prepare(random_sphere(50))
    assert result.mesh.faces.tolist() == [faces[i] for i in (0, 2, 4)]
    assert result.mesh.face_colors.tolist() == [colors[i].tolist() for i in (0, 2, 4)]
    kept = [0, 1, 2, 3, 5, 6]
    np.testing.assert_array_equal(result.mesh.vertices[kept], np.float32(vertices[kept]))
    assert np.isfinite(result.mesh.vertices).all()
    assert result.notes == ("apss: 3 of 6 faces dropped, a vertex is not finite",)


def test_finite_meshes_pass_untouched(fake: type[FakeMeshLab]) -> None:
    result = SurfaceApss().prepare(random_sphere(50))
    assert result.mesh is fake.result
    assert result.notes == ()


def test_no_finite_face_is_left(fake: type[FakeMeshLab]) -> None:
    vertices = np.full((6, 3), np.nan)
    fake.result = Mesh(vertices, faces_of(2), np.zeros((2, 3)))
    with pytest.raises(StageFailure, match="no face with finite vertices") as failure:
        SurfaceApss().prepare(random_sphere(50))
    assert failure.value.stage == "apss"


# --- every failure has a name ---------------------------------------------------------------------


def test_stages_in_order(fake: type[FakeMeshLab]) -> None:
    SurfaceApss().prepare(random_sphere(50))
    assert fake.log == STAGES
    SurfaceApss(resolution=77).prepare(random_sphere(50))
    assert fake.log == (*STAGES[:3], "apss 77")


@pytest.mark.parametrize("number", range(4))
def test_a_stage_that_raises_is_named(fake: type[FakeMeshLab], number: int) -> None:
    fake.raises = STAGES[number]
    with pytest.raises(StageFailure) as failure:
        SurfaceApss().prepare(random_sphere(50))
    assert failure.value.stage == STAGES[number].split()[0]
    assert failure.value.problem == "MeshLab says no"
    assert fake.log == STAGES[: number + 1]


@pytest.mark.parametrize("number", [1, 2, 3])
def test_a_stage_that_leaves_no_faces_is_named(fake: type[FakeMeshLab], number: int) -> None:
    fake.empties = STAGES[number]
    with pytest.raises(StageFailure) as failure:
        SurfaceApss().prepare(random_sphere(50))
    assert (failure.value.stage, failure.value.problem) == (STAGES[number].split()[0], "no faces")
    assert fake.log == STAGES[: number + 1]  # nothing runs on nothing


def test_bad_normals_are_named(fake: type[FakeMeshLab]) -> None:
    fake.bad_normal = True
    with pytest.raises(StageFailure, match="a normal is not finite") as failure:
        SurfaceApss().prepare(random_sphere(50))
    assert failure.value.stage == "normals"
    assert fake.log == STAGES[:1]


@pytest.mark.parametrize("count", [0, 1, 3, 10])
def test_too_few_points(fake: type[FakeMeshLab], count: int) -> None:
    with pytest.raises(StageFailure, match=f"{count} points; normals need at least 11") as failure:
        SurfaceApss().prepare(random_sphere(count))
    assert failure.value.stage == "input"
    assert fake.log == ()
    SurfaceApss().prepare(random_sphere(11))


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_single_point_that_is_not_finite(fake: type[FakeMeshLab], value: float) -> None:
    # Left to itself MeshLab would never return from such a cloud.
    points = random_sphere(50).points.copy()
    points[17, 1] = points[30, 0] = points[30, 2] = value
    with pytest.raises(StageFailure, match="2 of 50 points are not finite") as failure:
        SurfaceApss().prepare(PointCloud(points))
    assert failure.value.stage == "input"
    assert fake.log == ()


DEGENERATE = """
import json, numpy as np
from baselines.surface import SurfaceApss
from data_prep.failures import StageFailure
from data_prep.scene import PointCloud

rng = np.random.default_rng(0)
line = np.linspace(-1, 1, 50)[:, None]
plane = np.concatenate([rng.uniform(-0.7, 0.7, (200, 2)), np.zeros((200, 1))], axis=1)
ball = rng.normal(size=(100, 3))
ball *= 0.7 / np.linalg.norm(ball, axis=1, keepdims=True)
turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
clouds = {
    "ten": ball[:10],
    "nan": np.append(ball, [[np.nan, 0, 0]], axis=0),
    "inf": np.append(ball, [[0, np.inf, 0]], axis=0),
    "equal": np.full((50, 3), 0.3),
    "origin": np.zeros((50, 3)),
    "collinear": line * [1, 0, 0],
    "collinear-tilted": line * [0.5, 0.4, 0.3],
    "two-places": np.repeat([[0, 0, 0], [1, 0, 0]], 20, axis=0),
    "coplanar": plane,
    "coplanar-tilted": plane @ turn,
    "outlier": np.append(ball, [[1e6, 0, 0]], axis=0),
    "doubles": np.repeat(ball, 4, axis=0),
    "eleven": ball[:11],
    "noise": rng.normal(size=(500, 3)),
}
found = {}
for name, points in clouds.items():
    try:
        mesh = SurfaceApss(resolution=40).prepare(PointCloud(points)).mesh
        reach = np.abs(mesh.vertices).max() / np.abs(points).max()
        found[name] = ["ok", len(mesh.faces), float(reach)]
    except StageFailure as failure:
        found[name] = [failure.stage, failure.problem]
print(json.dumps(found))
"""


@pytest.fixture(scope="module")
def degenerate() -> dict[str, list]:
    # In a process of its own with a time limit: should MeshLab hang, the tests do not.
    done = subprocess.run(
        [sys.executable, "-c", DEGENERATE], capture_output=True, text=True, timeout=120, check=True
    )
    return json.loads(done.stdout)


@pytest.mark.parametrize(
    ("name", "outcome"),
    [  # the stages are MeshLab 2025.7's
        ("ten", ["input", "10 points; normals need at least 11"]),
        ("nan", ["input", "1 of 101 points are not finite"]),
        ("inf", ["input", "1 of 101 points are not finite"]),
        ("equal", ["apss", "no faces"]),
        ("origin", ["apss", "no faces"]),
        ("collinear", ["ball-pivoting", "no faces"]),
        ("collinear-tilted", ["ball-pivoting", "no faces"]),
        ("two-places", ["ball-pivoting", "no faces"]),
        ("coplanar", ["apss", "no faces"]),
        ("outlier", ["ball-pivoting", "no faces"]),
    ],
)
def test_degenerate_clouds_fail_by_name(
    degenerate: dict[str, list], name: str, outcome: list[str]
) -> None:
    assert degenerate[name] == outcome


@pytest.mark.parametrize("name", ["coplanar-tilted", "doubles", "eleven", "noise"])
def test_ugly_clouds_give_a_mesh_of_their_size(degenerate: dict[str, list], name: str) -> None:
    outcome, faces, reach = degenerate[name]
    assert outcome == "ok"
    assert faces > 100
    assert 0.5 < reach < 2


def test_default_resolution_is_the_papers() -> None:
    assert SurfaceApss() == SurfaceApss(resolution=200)
