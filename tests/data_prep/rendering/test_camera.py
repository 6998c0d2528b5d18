from __future__ import annotations

import math

import numpy as np
import pytest

from data_prep.rendering.camera import (
    CAMERA_DISTANCE,
    FIELD_OF_VIEW_RAD,
    FOCAL_PX,
    camera_to_world,
    project,
)
from data_prep.scene import View

EPS = float(np.finfo(np.float64).eps)
# Entries of a pose are products of two sines or cosines, each within one ulp (2**-52) of the truth
# for an angle that is itself rounded (2**-52 of at most pi): some 5 eps. 16 is ample.
POSE = 16 * EPS
# Pixels: coordinates of order 10 times 232 over a depth of 3 or more, from entries as above.
PIXELS = 1000 * POSE
VIEWS = [View(a, e) for a in (-180, -33.3, 0, 90) for e in (-90, -40, 12.5, 90)]


def looking_at_the_origin(view: View) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Eye, right, up, backward the usual way, from cross products; not for the poles."""
    azimuth, elevation = math.radians(view.azimuth_deg), math.radians(view.elevation_deg)
    # From -Z (the front) clockwise as seen from above, that is by way of +X.
    eye = CAMERA_DISTANCE * np.array(
        [
            math.cos(elevation) * math.sin(azimuth),
            math.sin(elevation),
            -math.cos(elevation) * math.cos(azimuth),
        ]
    )
    backward = eye / np.linalg.norm(eye)
    right = np.cross([0.0, 1.0, 0.0], backward)
    right /= np.linalg.norm(right)
    return eye, right, np.cross(backward, right), backward


def test_lens_of_the_original() -> None:
    assert CAMERA_DISTANCE == 4.0
    # 58 mm on 32 mm sensor and 128 pixels: 128 * 58 / 32; tan(atan(x)) costs a few ulps.
    assert pytest.approx(232.0, rel=4 * EPS) == FOCAL_PX
    assert math.degrees(FIELD_OF_VIEW_RAD) == pytest.approx(30.84, abs=0.005)  # two digits given


@pytest.mark.parametrize("view", VIEWS, ids=str)
def test_pose_is_rigid_and_looks_at_the_origin_from_distance_4(view: View) -> None:
    pose = camera_to_world(view)
    assert pose.dtype == np.float64
    np.testing.assert_allclose(pose[:3, :3].T @ pose[:3, :3], np.eye(3), rtol=0, atol=POSE)
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1.0, abs=POSE)
    assert pose[3].tolist() == [0, 0, 0, 1]
    assert pose[1, 0] == 0.0  # the horizon is level, and up is up
    assert pose[1, 1] == pytest.approx(math.cos(math.radians(view.elevation_deg)), abs=POSE)
    np.testing.assert_allclose(pose[:3, 3], 4.0 * pose[:3, 2], rtol=0, atol=4 * POSE)
    pixels, depth = project(np.zeros((1, 3)), view)
    np.testing.assert_allclose(pixels, [[64.0, 64.0]], rtol=0, atol=PIXELS)
    assert depth[0] == pytest.approx(4.0, abs=4 * POSE)


@pytest.mark.parametrize(
    ("azimuth", "elevation", "position"),
    [
        (0, 0, (0, 0, -4)),  # sees the front
        (-180, 0, (0, 0, 4)),
        (450, 0, (4, 0, 0)),
        (45, -30, (math.sqrt(6), -2, -math.sqrt(6))),
        (0, 90, (0, 4, 0)),
        (77, -90, (0, -4, 0)),
    ],
)
def test_where_the_camera_stands(azimuth: float, elevation: float, position: tuple) -> None:
    pose = camera_to_world(View(azimuth, elevation))
    np.testing.assert_allclose(pose[:3, 3], position, rtol=0, atol=4 * POSE)


@pytest.mark.parametrize("view", [v for v in VIEWS if abs(v.elevation_deg) < 89], ids=str)
def test_projection_agrees_with_look_at_and_a_pinhole(view: View) -> None:
    points = np.random.default_rng(4).uniform(-1, 1, (200, 3))
    eye, right, up, backward = looking_at_the_origin(view)
    x, y, z = ((points - eye) @ axis for axis in (right, up, backward))
    pixels, depth = project(points, view)
    np.testing.assert_allclose(depth, -z, rtol=0, atol=100 * POSE)
    np.testing.assert_allclose(pixels[:, 0], 64 + 232 * x / -z, rtol=0, atol=PIXELS)
    np.testing.assert_allclose(pixels[:, 1], 64 - 232 * y / -z, rtol=0, atol=PIXELS)


def test_azimuth_is_periodic() -> None:
    # The angle is reduced before it becomes radians: a thousand turns cost no digits.
    once, again = (camera_to_world(View(12.5 + 360 * k, 20)) for k in (0, -1000))
    np.testing.assert_allclose(again, once, rtol=0, atol=4 * POSE)


def test_points_behind_the_camera_none_and_what_is_no_point() -> None:
    _, depth = project(np.array([[0, 0, -5.0], [0, 0, -4.0], [0, 0, -3.0]]), View(0, 0))
    np.testing.assert_allclose(depth, [-1, 0, 1], rtol=0, atol=4 * POSE)
    pixels, depth = project(np.zeros((0, 3), np.float32), View(0, 0))
    assert (pixels.shape, depth.shape) == ((0, 2), (0,))
    pixels, depth = project(np.full((2, 3), np.nan, np.float32), View(0, 0))
    assert pixels.dtype == depth.dtype == np.float64
    assert np.isnan([*pixels.T, depth]).all()
