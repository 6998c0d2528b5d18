from __future__ import annotations

import math
import os
import subprocess
import sys
from collections.abc import Sequence

import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull

from data_prep.datasets.registry import ProceduralObject
from data_prep.rendering.camera import camera_to_world, project
from data_prep.rendering.opengl import SHEET_VIEWS, gl_renderer, render
from data_prep.scene import Mesh, View
from data_prep.shapes.chair.chairs import chair
from data_prep.shapes.solids import box, join

pytestmark = pytest.mark.opengl

FRONT = View(0, 0)
VIEWS = [View(0, 0), View(35, 20), View(-120, -40), View(180, 0), View(10, 90), View(-77, -90)]
GAMMA = 2.2

# The driver rounds to the nearest of 255 levels: half a level. The facet's slope comes from
# differences of float32 eye coordinates of order 4 (half an ulp is 2.4e-7) one pixel apart (4 / 232
# = 0.017): 3e-5, which moves 255 cos(t)^(1/2.2) by 255 / 2.2 tan(t) * 3e-5 = 0.01 at 70 degrees.
LEVEL = 0.5 + 0.02

# The four samples of a pixel lie within its square, whose corners are sqrt(0.5) = 0.707 from its
# centre; the rasteriser snaps vertices to 1/256 pixel. What is farther from an edge is not touched.
CLEAR_PX = 0.72


def colored(vertices: object, faces: object, color: Sequence[int] = (180, 120, 60)) -> Mesh:
    return Mesh(vertices, faces, np.tile(np.array(color, np.uint8), (len(faces), 1)))


def plate(
    z: float = 0.0, half: float = 0.4, color: Sequence[int] = (180, 120, 60), tilt_deg: float = 0.0
) -> Mesh:
    """Square in front of the camera at azimuth 0; +z is away; tilted about the x axis."""
    corners = np.array([[-half, -half], [half, -half], [half, half], [-half, half]])
    cos, sin = math.cos(math.radians(tilt_deg)), math.sin(math.radians(tilt_deg))
    vertices = np.stack([corners[:, 0], cos * corners[:, 1], z + sin * corners[:, 1]], axis=1)
    return colored(vertices, [[0, 2, 1], [0, 3, 2]], color)


def together(*meshes: Mesh) -> Mesh:
    starts = np.cumsum([0, *(len(m.vertices) for m in meshes[:-1])])
    return Mesh(
        np.concatenate([m.vertices for m in meshes]),
        np.concatenate([m.faces + s for m, s in zip(meshes, starts, strict=True)]),
        np.concatenate([m.face_colors for m in meshes]),
    )


def sphere(subdivisions: int, color: Sequence[int]) -> Mesh:
    ball = trimesh.creation.icosphere(subdivisions=subdivisions, radius=1.0)
    return colored(ball.vertices, ball.faces, color)


def rendered(mesh: Mesh, view: View = FRONT) -> np.ndarray:
    (image,) = render(mesh, [view])
    return image


def test_mesh_without_faces_is_white_and_non_finite_vertices_are_refused() -> None:
    images = render(Mesh(np.eye(3), np.zeros((0, 3)), np.zeros((0, 3))), VIEWS[:2])
    assert images.shape == (2, 128, 128, 3)
    assert (images == 255).all()
    for value in (np.nan, -np.inf):
        vertices = np.zeros((4, 3), np.float32)
        vertices[3, 1] = value  # no face uses it
        for faces in ([[0, 1, 2]], np.zeros((0, 3))):
            with pytest.raises(ValueError, match="non-finite"):
                render(colored(vertices, faces), [FRONT])


def test_every_level_of_every_face_arrives_at_its_place() -> None:
    # 16 x 16 squares, one for each of the 256 levels, none of which has its neighbour's colour.
    side = np.linspace(-0.8, 0.8, 17)
    x, y = np.meshgrid(side, side, indexing="ij")
    vertices = np.stack([x.ravel(), y.ravel(), np.zeros(17 * 17)], axis=1)
    i, j = (k.ravel() for k in np.meshgrid(np.arange(16), np.arange(16), indexing="ij"))
    first = 17 * i + j
    faces = (first[:, None] + [0, 1, 18, 0, 18, 17]).reshape(-1, 3)
    level = np.random.default_rng(3).permutation(256)
    colors = np.stack([level, 255 - level, level * 7 % 256], axis=1)
    image = rendered(Mesh(vertices, faces, np.repeat(colors, 2, axis=0)))
    middles = np.stack([side[i] + 0.05, side[j] + 0.05, np.zeros(256)], axis=1)
    pixels, _ = project(middles, FRONT)  # a square is 5.8 pixels wide: its middle pixel is inside
    column, row = np.floor(pixels).astype(int).T
    np.testing.assert_array_equal(image[row, column], colors)


@pytest.mark.parametrize("tilt", [-70, 10, 45])
def test_tilted_facet(tilt: float) -> None:
    color = (255, 120, 60)
    expected = np.array(color) * math.cos(math.radians(tilt)) ** (1 / GAMMA)
    tilted = plate(color=color, tilt_deg=tilt)
    for mesh in (tilted, with_second_colour(tilted)):
        image = rendered(mesh)
        middle = image[61:67, 50:78].astype(float)  # 0.4 cos 70 * 58 = 8 pixels up and down
        assert np.abs(middle - expected).max() <= LEVEL


def with_second_colour(mesh: Mesh) -> Mesh:
    """The mesh with a far-off facet of another colour: the other way in which colours travel."""
    return together(
        mesh, colored([[0.9, 0.9, 0], [0.95, 0.9, 0], [0.9, 0.95, 0]], [[0, 1, 2]], (0,) * 3)
    )


def test_both_sides_are_shaded_alike_and_slivers_change_nothing() -> None:
    mesh = plate(tilt_deg=40)
    turned = Mesh(mesh.vertices, mesh.faces[:, ::-1], mesh.face_colors)
    slivers = Mesh(mesh.vertices, [[0, 0, 0], [1, 1, 2], [0, 2, 2]], np.full((3, 3), 9))
    image = rendered(mesh)
    assert (image[64, 64] < 255).all()
    for other in (turned, together(mesh, slivers)):
        np.testing.assert_array_equal(rendered(other), image)


def hull_distance(points: np.ndarray) -> np.ndarray:
    """Signed distance [128, 128] of the pixel centres to the convex hull of pixels [N, 2].

    Outside it is the distance to the farthest edge's line, which is not more than the true one.
    """
    row, column = np.mgrid[:128, :128] + 0.5
    lines = ConvexHull(points).equations  # unit normal pointing out, offset
    return (
        (lines[:, :2] @ [column.ravel(), row.ravel()] + lines[:, 2:]).max(axis=0).reshape(128, 128)
    )


@pytest.mark.parametrize("view", VIEWS, ids=str)
@pytest.mark.parametrize("kind", ["box", "polytope"])
def test_silhouette_of_a_convex_mesh(kind: str, view: View) -> None:
    if kind == "box":
        mesh = join([box((0.1, -0.2, 0.3), (0.5, 0.9, 0.4), (10, 20, 30))])
    else:
        cloud = np.random.default_rng(12).normal(size=(12, 3))
        hull = trimesh.convex.convex_hull(0.9 * cloud / np.linalg.norm(cloud, axis=1).max())
        mesh = colored(hull.vertices, hull.faces, (10, 20, 30))
    pixels, _ = project(mesh.vertices, view)
    distance = hull_distance(pixels)
    image = rendered(mesh, view)
    assert (image[distance > CLEAR_PX] == 255).all()
    assert (image[distance < -CLEAR_PX] <= (10, 20, 30)).all()
    edge = image[np.abs(distance) < 0.1].mean()
    assert 60 < edge < 195  # about half covered: no systematic shift of half a pixel


def test_silhouette_of_the_unit_sphere() -> None:
    # Black on white: 1 - level / 255 is the covered share of a pixel, so its sum is an area.
    image = rendered(sphere(5, (0, 0, 0)), View(20, 10))
    area = (1 - image[..., 0] / 255.0).sum()
    radius = 232 / math.sqrt(4**2 - 1)
    # Facets of 0.035 cut 0.035^2 / 8 = 2e-4 of the radius, 0.01 px. Four samples tell the share of
    # a pixel to 0.15 or so; over the 380 pixels of the rim that is 3 square pixels, 0.01 px.
    assert math.sqrt(area / math.pi) == pytest.approx(radius, abs=0.03)


def test_edges_have_four_samples() -> None:
    levels = np.unique(rendered(sphere(3, (0, 0, 0))))
    # Means of four black or white samples: multiples of 63.75, rounded either way.
    assert np.abs(levels - 63.75 * np.round(levels / 63.75)).max() <= 0.75
    assert set(np.round(levels / 63.75).astype(int)) == {0, 1, 2, 3, 4}


@pytest.mark.parametrize(
    ("depth", "seen"), [(0.19, False), (0.21, True), (9.9, True), (10.1, False)]
)
def test_what_leaves_the_cameras_range_is_cut_off(depth: float, seen: bool) -> None:
    image = rendered(plate(z=depth - 4, half=0.1 * depth))
    assert (image[64, 64].tolist() == [180, 120, 60]) is seen
    assert (image < 255).any() == seen


def first_hits(mesh: Mesh, view: View, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Face [N] first hit by the rays through pixels [N, 2], -1 for none, and how clearly first.

    Intersections of lines and triangles after Möller and Trumbore (1997), in float64: nothing is
    shared with the renderer but the pose. The second result is the distance to the next hit.
    """
    pose = camera_to_world(view)
    rays = np.concatenate([(pixels - 64) / 232 * (1, -1), -np.ones((len(pixels), 1))], axis=1)
    rays = rays @ pose[:3, :3].T
    a, b, c = mesh.vertices.astype(np.float64)[mesh.faces].transpose(1, 0, 2)
    ab, ac, start = b - a, c - a, pose[:3, 3] - a
    # Scalar triple products, so that all rays times all faces are matrix products.
    normal = np.cross(ab, ac)
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = -1 / (rays @ normal.T)
        u = (rays @ np.cross(ac, start).T) * scale
        v = (rays @ np.cross(start, ab).T) * scale
        t = (start * normal).sum(axis=1) * scale
        t[~((u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0))] = np.inf
    order = np.argpartition(t, 1, axis=1)[:, :2]
    nearest, second = np.sort(np.take_along_axis(t, order, axis=1), axis=1).T
    face = np.where(np.isfinite(nearest), t.argmin(axis=1), -1)
    return face, np.where(face >= 0, second - np.where(face >= 0, nearest, 0), np.inf)


@pytest.mark.parametrize(("seed", "view"), [(0, View(25, 15)), (5, View(-150, -35))])
def test_first_hit_faces_agree_with_a_ray_caster(seed: int, view: View) -> None:
    source = chair(np.random.default_rng(seed))
    colors = np.random.default_rng(seed).integers(0, 200, (len(source.faces), 3))
    mesh = Mesh(source.vertices, source.faces, colors)
    row, column = (k.ravel() for k in np.mgrid[1:127:3, 1:127:3])
    centre = np.stack([column, row], axis=1) + 0.5
    # A pixel is judged where its centre and its corners (0.51: the samples lie inside) agree.
    corners = [first_hits(mesh, view, centre + shift) for shift in 0.51 * CORNERS]
    face, gap = first_hits(mesh, view, centre)
    alike = np.all([other == face for other, _ in corners], axis=0)
    clear = np.min([gap, *(g for _, g in corners)], axis=0) > 1e-3  # no two faces at one depth
    judged = alike & clear
    hit = judged & (face >= 0)
    assert hit.sum() > 100
    assert (judged & (face < 0)).sum() > 300
    solid = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    cosine = np.abs(solid.face_normals @ camera_to_world(view)[:3, 2])
    shade = colors * cosine[:, None] ** (1 / GAMMA)
    found = rendered(mesh, view)[row, column]
    assert (found[judged & (face < 0)] == 255).all()
    steep = cosine[face] > 0.3  # LEVEL holds up to 70 degrees
    assert np.abs(found - shade[face])[hit & steep].max() <= LEVEL


CORNERS = np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]])


def test_views_may_be_more_than_a_sheet_holds() -> None:
    """Each image is the same whatever was drawn before."""
    mesh = chair(np.random.default_rng(1))
    one_by_one = np.concatenate([render(mesh, [view]) for view in VIEWS])
    for count in (SHEET_VIEWS, SHEET_VIEWS + 1, 2 * SHEET_VIEWS + 3):
        which = np.arange(count) % len(VIEWS)
        np.testing.assert_array_equal(
            render(mesh, [VIEWS[i] for i in which]), one_by_one[which], strict=True
        )
        render(sphere(4, (10, 20, 30)), VIEWS)


def test_colours_at_shared_vertices() -> None:
    """Two facets with an edge in common, on either side of the middle: colours must not mix."""
    both = [[200, 0, 0], [0, 0, 200]]
    image = rendered(
        Mesh([[0, -1, 0], [0, 1, 0], [1, 0, 0], [-1, 0, 0]], [[0, 1, 2], [0, 1, 3]], both)
    )
    assert image[64, 61].tolist() == both[0]  # +x is on the left of the front
    assert image[64, 66].tolist() == both[1]


def test_the_driver_has_a_name_and_a_version() -> None:
    image = rendered(plate())
    name, _, version = gl_renderer().partition(" / ")
    assert name
    assert version[0].isdigit()
    np.testing.assert_array_equal(rendered(plate()), image)  # asking leaves the context usable


NO_PACKAGE = "import sys; sys.modules['pyrender'] = None"
NO_DRIVER = {"__EGL_VENDOR_LIBRARY_FILENAMES": "none.json"}


@pytest.mark.parametrize(
    ("prelude", "drivers", "remedy"),
    [
        (NO_PACKAGE, {}, "package pyrender: run 'bench doctor --install'"),
        ("", NO_DRIVER, "install the Debian packages libegl1 "),
    ],
)
def test_what_is_missing_is_named(prelude: str, drivers: dict, remedy: str) -> None:
    code = f"{prelude}\nfrom data_prep.rendering.opengl import gl_renderer\ngl_renderer()"
    done = subprocess.run(
        [sys.executable, "-c", code], env=os.environ | drivers, capture_output=True, text=True
    )
    last = done.stderr.strip().splitlines()[-1]
    assert done.returncode == 1
    assert last.startswith("data_prep.failures.MissingDependency: ")
    assert remedy in last


def test_a_image_of_another_size_shows_the_same():
    """A pixel's centre of the smaller image is a corner of four in the larger one: inside a facet
    all agree, and along an edge the samples of one are spread over the four."""
    mesh = ProceduralObject("chair", "test", 3).load()
    views = [View(30.0, 20.0), View(-100.0, -10.0)]
    images = render(mesh, views)
    large, small = render(mesh, views, 256), render(mesh, views, 64)
    assert large.shape == (2, 256, 256, 3)
    assert small.shape == (2, 64, 64, 3)
    for fine, coarse in ((large, images), (images, small)):
        side = coarse.shape[1]
        means = fine.reshape(2, side, 2, side, 2, 3).astype(float).mean(axis=(2, 4))
        inside = np.ptp(fine.reshape(2, side, 2, side, 2, 3), axis=(2, 4)).max(axis=-1) == 0
        assert inside.mean() > 0.7
        # one grey level of rounding, and facets of different tilt that meet in a pixel
        assert (np.abs(means - coarse).max(axis=-1)[inside] > 1).mean() < 0.002
    # buffers of one size do not touch those of another
    assert np.array_equal(render(mesh, views), images)
    assert np.array_equal(render(mesh, views, 256), large)
