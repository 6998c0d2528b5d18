"""The variants against closed forms, and the table on one chair."""

from __future__ import annotations

import math

import numpy as np
import pytest
import trimesh

from benchmarks import scene_economy
from benchmarks.render_speed import sphere
from benchmarks.scene_economy import (
    BEGIN,
    END,
    VARIANTS,
    at_image_size,
    decimated,
    divided,
    levels,
    measure,
    with_tables,
)
from benchmarks.scene_variants import (
    FIXED_LIGHT,
    INTERPOLATED,
    Scene,
    corner_normals,
    draw,
    reduced,
    vertices_of,
)
from data_prep.camera import FOCAL_PX
from data_prep.datasets import ProceduralObject
from data_prep.failures import BadInput
from data_prep.render import render
from data_prep.sampling import random_views
from data_prep.scene import Mesh, View
from data_prep.shapes.solids import box, join

FRONT = View(0, 0)
VIEWS = (View(180, 90), *random_views(5, np.random.default_rng(4)))
COLOUR = np.array([180, 120, 60])
BY_NAME = {variant.name: variant for variant in VARIANTS}
# Rounding to 255 levels, and what float32 differences of eye coordinates leave of a facet's normal
# (tests/data_prep/test_render.py, LEVEL).
LEVEL = 0.52


def picture(mesh: Mesh, scene: Scene, view: View = FRONT) -> np.ndarray:
    (image,) = draw(scene, vertices_of(mesh, scene.crease_deg), [view])
    return image


def plate(tilt_deg: float) -> Mesh:
    """Square through the origin, tilted about x; its upper edge goes back. Seen from its front."""
    back = np.array([0, math.cos(math.radians(tilt_deg)), math.sin(math.radians(tilt_deg))])
    side = np.array([1.0, 0, 0])
    corners = [-side - back, side - back, side + back, -side + back]
    return Mesh(0.5 * np.array(corners), [[0, 2, 1], [0, 3, 2]], np.tile(np.uint8(COLOUR), (2, 1)))


def test_the_default_scene_is_the_project_s():
    for i in range(3):
        mesh = ProceduralObject("chair", "test", i).load()
        drawn = draw(Scene(), vertices_of(mesh, None), VIEWS)
        np.testing.assert_array_equal(drawn, render(mesh, VIEWS), strict=True)


# cos of the tilt, of the light's angle; the middle of the picture looks along the axis
TILT = 50.0
COS = math.cos(math.radians(TILT))
FACING = np.array([0, math.sin(math.radians(TILT)), -COS])  # the plate's normal, to the camera
FIXED_COS = float(FACING @ FIXED_LIGHT / np.linalg.norm(FIXED_LIGHT))


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("default", COLOUR * COS ** (1 / 2.2)),
        ("none: a facet's own colour", COLOUR),
        ("lamp at the camera instead", COLOUR * COS ** (1 / 2.2)),
        ("headlight, a quarter ambient", COLOUR * (0.25 + 0.75 * COS) ** (1 / 2.2)),
        ("headlight and a fixed one", COLOUR * (0.5 * COS + 0.5 * FIXED_COS) ** (1 / 2.2)),
        ("shaded without", COLOUR * COS),
        ("Blinn's, half the light",
         255 * ((COLOUR / 255) ** 2.2 * COS + 0.5 * COS**50) ** (1 / 2.2)),
        ("smooth everywhere", COLOUR * COS ** (1 / 2.2)),
    ],
)  # fmt: skip
def test_shading_of_a_tilted_plate(name, expected):
    assert FIXED_COS > 0.5
    image = picture(plate(TILT), BY_NAME[name].scene)
    # Half a pixel off the axis turns the way to the camera by 0.5 / FOCAL_PX = 0.0022: tan(50) of
    # that of the cosine, 0.0026 of 208 levels / 2.2.
    assert np.abs(image[63:65, 63:65] - expected).max() <= LEVEL + 0.25


def test_specular_light_falls_off():
    scene = BY_NAME["Blinn's, half the light"].scene
    # Seen head-on 0.4 from the middle: half way between light and camera is half of atan(0.4 / 4).
    column = 64 + math.floor(0.4 * FOCAL_PX / 4)
    away = (column + 0.5 - 64) / FOCAL_PX
    shine = 0.5 * math.cos(math.atan(away) / 2) ** 50
    expected = 255 * np.minimum((COLOUR / 255) ** 2.2 + shine, 1) ** (1 / 2.2)
    assert np.abs(picture(plate(0), scene)[64, column] - expected).max() <= LEVEL


def test_the_fixed_light_stays_with_the_object():
    # A face of a cube has the same amount of it from wherever it is seen.
    scene = Scene(color="face_color * max(dot(seen, fixed_light), 0.0)")
    cube = join([box((0, 0, 0), (0.8, 0.8, 0.8), (250, 250, 250))])
    light = np.array(FIXED_LIGHT) / np.linalg.norm(FIXED_LIGHT)
    expected = {round(250 * max(sign * light[k], 0)) for k in range(3) for sign in (1, -1)} | {255}
    for view in VIEWS:
        image = picture(cube, Scene(color=scene.color, samples=1), view)[..., 0]
        assert all(min(abs(int(v) - e) for e in expected) <= 1 for v in np.unique(image))
    top = picture(cube, scene, View(20, 90))[64, 64, 0]
    assert abs(top - 250 * light[1]) <= LEVEL


def test_faces_seen_from_behind():
    culled = BY_NAME["not drawn"].scene
    assert (picture(plate(0), culled)[64, 64] == COLOUR).all()
    assert (picture(plate(0), culled, View(180, 0)) == 255).all()
    cube = join([box((0, 0, 0), (0.8, 0.9, 0.7), (10, 20, 30))])
    inside_out = Mesh(cube.vertices, cube.faces[:, ::-1], cube.face_colors)
    for view in VIEWS[1:]:  # without the one along a side, where front and back have one depth
        np.testing.assert_array_equal(picture(cube, culled, view), picture(cube, Scene(), view))
        assert (picture(inside_out, culled, view) != picture(cube, Scene(), view)).any()


@pytest.mark.parametrize(
    ("name", "count"), [("1 sample", 1), ("default", 4), ("4, 2 x 2 pixels for one", 4),
                        ("16 samples", 16), ("64 samples", 64)]
)  # fmt: skip
def test_number_of_samples(name, count):
    black = sphere(3)
    black = Mesh(black.vertices, black.faces, np.zeros_like(black.face_colors))
    found = np.unique(picture(black, BY_NAME[name].scene)).astype(float) * count / 255
    # The driver's mean of 4 is rounded before the mean of pixels is: at most half a level twice.
    assert np.abs(found - np.round(found)).max() <= 1.0 * count / 255 + 1e-9
    if count <= 16:
        assert {*np.round(found).astype(int)} == {*range(count + 1)}


def test_means_of_pixels():
    pictures = np.zeros((2, 4, 6, 3), np.uint8)[:, :, :4]
    pictures[0, ::2, ::2] = pictures[0, 1::2, 1::2] = 255
    pictures[1, :2, :2] = [[[8] * 3, [9] * 3], [[9] * 3, [10] * 3]]
    halved = reduced(pictures, 2)
    assert halved.shape == (2, 2, 2, 3)
    assert (halved[0] == 128).all()  # 127.5, half up
    assert halved[1, ..., 0].tolist() == [[9, 0], [0, 0]]
    assert (reduced(pictures, 2, 2.2)[0] == round(255 * 0.5 ** (1 / 2.2))).all()


def test_normals_of_corners():
    cube = join([box((0, 0, 0), (1, 2, 4), (9, 9, 9))])
    points = cube.vertices[cube.faces].astype(float)
    facets = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
    facets /= np.linalg.norm(facets, axis=1, keepdims=True)
    for crease in (0.0, 30.0, 89.0):
        creased = corner_normals(cube, crease)
        np.testing.assert_allclose(creased, np.repeat(facets[:, None], 3, axis=1), atol=1e-12)
    everywhere = corner_normals(cube, 180.0)
    # Weighted by area, of which a corner has one or two halves of each side (2 x 4, 1 x 4, 1 x 2).
    halves = np.abs(everywhere) / (4, 2, 1)
    halves /= halves.min(axis=-1, keepdims=True)
    assert {*np.round(halves.ravel(), 6)} <= {1.0, 2.0}
    assert (np.sign(everywhere) == np.sign(points)).all()
    # A degenerate facet has none, and takes no part.
    flat = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2], [0, 1, 1]], np.zeros((2, 3)))
    np.testing.assert_array_equal(corner_normals(flat, 180.0)[0], [[0, 0, 1]] * 3)
    np.testing.assert_array_equal(corner_normals(flat, 30.0)[1], [[0, 0, 0]] * 3)


def test_a_smooth_sphere_is_shaded_as_a_sphere():
    ball = sphere(4)
    image = picture(ball, Scene(normal=INTERPOLATED, crease_deg=180.0))[..., 0].astype(float)
    # The ray through a pixel meets |p| = 1 where the normal is p itself.
    row, column = np.mgrid[:128, :128] + 0.5 - 64
    ray = np.stack([column, -row, np.full_like(row, -FOCAL_PX)], axis=-1)
    ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
    along = -4 * ray[..., 2]
    inside = along**2 - 15
    depth = along - np.sqrt(np.maximum(inside, 0))
    cosine = 4 + depth * ray[..., 2]
    # A facet's middle lies (0.083 / sqrt(3))^2 / 2 = 0.0012 below the sphere (edges of 0.083):
    # there the ray meets the sphere 0.0012 tan t beside it, which moves the cosine by sin t times
    # that. Four times so much is allowed: facets are not equal, and normals of vertices are means.
    shown = (inside > 0) & (cosine > 0.4)
    expected = 150 * cosine[shown] ** (1 / 2.2)
    slope = 150 / 2.2 * cosine[shown] ** (1 / 2.2 - 1)
    allowed = LEVEL + slope * 0.005 * (1 + (1 - cosine[shown] ** 2) / cosine[shown])
    assert (np.abs(image[shown] - expected) <= allowed).all()
    flat = picture(ball, Scene())[..., 0].astype(float)
    assert (np.abs(flat[shown] - expected) > allowed).any()


def test_divided_meshes_are_the_same_surface():
    mesh = ProceduralObject("chair", "test", 0).load()
    finer = divided(2)(mesh)
    assert len(finer.faces) == 16 * len(mesh.faces)

    def areas(m: Mesh) -> np.ndarray:
        return trimesh.Trimesh(m.vertices, m.faces, process=False).area_faces

    # float32 coordinates: 6e-8 of lengths, of edges down to 0.005 / 4
    np.testing.assert_allclose(areas(finer).reshape(-1, 16).sum(axis=1), areas(mesh), rtol=1e-3)
    assert (finer.face_colors.reshape(-1, 16, 3) == mesh.face_colors[:, None]).all()
    normals = (
        trimesh.Trimesh(m.vertices, m.faces, process=False).face_normals for m in (finer, mesh)
    )
    turned = [*normals]
    assert (turned[0].reshape(-1, 16, 3) * turned[1][:, None]).sum(axis=-1).min() > 0.999


def test_decimated_meshes():
    ball = sphere(4)
    coarse = decimated(1 / 4)(ball)
    assert 0.2 < len(coarse.faces) / len(ball.faces) <= 0.25
    assert (coarse.face_colors == ball.face_colors[0]).all()
    assert np.abs(np.linalg.norm(coarse.vertices, axis=1) - 1).max() < 0.02
    two = Mesh(ball.vertices, ball.faces, np.where(ball.vertices[ball.faces[:, :1], 0] > 0, 9, 200)
               * np.ones(3, int))  # fmt: skip
    assert {*map(tuple, decimated(1 / 2)(two).face_colors.tolist())} == {(9,) * 3, (200,) * 3}


def test_levels_are_of_what_is_shown():
    a, b = np.full((2, 2, 4, 4, 3), 255, np.uint8)
    assert levels(a, b) == 0.0
    a[0, 0, 0], b[0, 0, 0] = (10, 20, 30), (20, 20, 20)  # by 10, 0, 10
    b[1, 3, 3] = (255, 255, 0)  # by 0, 0, 255
    assert levels(a, b) == pytest.approx((20 + 255) / 6)


def test_smaller_pictures_are_enlarged():
    small = np.full((1, 64, 64, 3), 255, np.uint8)
    small[:, :, :32] = 0
    large = at_image_size(small)
    assert large.shape == (1, 128, 128, 3)
    assert (large[0, :, :63] == 0).all()
    assert (large[0, :, 65:] == 255).all()
    assert at_image_size(large) is large


def test_the_table_of_one_chair():
    wanted = [BY_NAME[name] for name in ("default", "64 samples", "1 sample", "shaded without")]
    found = measure("procedural", [ProceduralObject("chair", "validation", 0)], 2, 1, wanted)
    default, finest, single, linear = found
    assert [r.variant for r in found] == [v.name for v in wanted]
    assert (default.ssim, default.levels, default.times) == (1.0, 0.0, 1.0)
    assert (finest.ssim, finest.levels) == (1.0, 0.0)
    assert single.against == "64 samples"
    assert 0.9 < single.ssim_lowest <= single.ssim < 0.995
    assert linear.ssim < 1.0
    assert linear.levels > 1.0
    assert {(r.chairs, r.views) for r in found} == {(1, 2)}
    page = scene_economy.tables([linear._replace(ms=1.234, times=2.5)])
    assert "### 1 procedural chairs" in page
    assert f"| gamma | shaded without | default | {linear.ssim:.4f} |" in page
    assert page.rstrip().endswith("| 1.23 | 2.50 |")


def test_variants_are_held_against_one_another():
    assert len(BY_NAME) == len(VARIANTS)
    assert VARIANTS[0] == BY_NAME["default"]
    assert {v.against for v in VARIANTS} <= BY_NAME.keys()


def test_tables_go_between_the_marks():
    assert with_tables(f"a {BEGIN} old {END} z", "new") == f"a {BEGIN}\n\nnew\n{END} z"
    for page in ("", BEGIN, END, f"{END} {BEGIN}"):
        with pytest.raises(BadInput, match="put them where tables belong"):
            with_tables(page, "new")
