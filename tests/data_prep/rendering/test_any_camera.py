"""Cameras of users: where points and meshes appear, and a camera that is that of a view."""

from __future__ import annotations

import numpy as np
import pytest

from data_prep.rendering.camera import (
    FOCAL_PX,
    camera_to_world,
    depth_range,
    farthest_depth,
    lens_of,
    origin_depth,
    project,
)
from data_prep.rendering.opengl import render
from data_prep.rendering.raycast import cast, surface_maps
from data_prep.scene import Camera, Mesh, View

FRONT = View(0, 0)  # it stands at z = -4; its x points to -X
# Three times as far as the front, turned by 90 degrees about its axis, with a long lens.
FAR_AWAY = Camera(
    np.array([[0, 1.0, 0, 0], [1, 0, 0, 0], [0, 0, -1, -12], [0, 0, 0, 1]]), (700, 714), (50, 80)
)


def test_points_appear_where_a_pinhole_shows_them():
    assert (origin_depth(FAR_AWAY), farthest_depth(FAR_AWAY)) == (12, 13.25)
    assert depth_range(FAR_AWAY) == pytest.approx((8.2, 18))
    pixels, depth = project(np.array([[0.3, -0.2, 0.5], [0, 0, -13]]), FAR_AWAY)
    np.testing.assert_allclose(depth, [12.5, -1])
    np.testing.assert_allclose(pixels[0], [50 + 700 * -0.2 / 12.5, 80 - 714 * 0.3 / 12.5])


def test_the_camera_of_a_view_draws_the_same_bytes():
    camera = Camera(camera_to_world(FRONT), (FOCAL_PX, FOCAL_PX), (64, 64))
    assert (lens_of(camera), depth_range(camera)) == (lens_of(FRONT), depth_range(FRONT))
    corners = np.random.default_rng(1).uniform(-1, 1, (60, 3)).astype(np.float32)
    mesh = Mesh(corners, np.arange(60).reshape(20, 3), np.full((20, 3), 90))
    for draw in (render, cast, surface_maps):
        assert np.array_equal(draw(mesh, [camera]), draw(mesh, [FRONT]))


@pytest.mark.parametrize("draw", [render, cast])
def test_a_square_of_a_mesh_appears_where_a_pinhole_shows_it(draw):
    # A square that faces the camera covers pixels around the image of its middle alone.
    middle, half = np.array([0.3, -0.2, 0.5]), 0.1
    sides = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    faces, black = np.array([[0, 1, 2], [0, 2, 3]]), np.zeros((2, 3))
    mesh = Mesh(middle + half * sides, faces, black)
    (image, *_) = draw(mesh, [FAR_AWAY, FRONT], size=256)
    rows, columns = (np.mgrid[:256, :256] + 0.5) / 2
    darkness = 1 - image[..., 0] / 255
    seen = [np.average(columns, weights=darkness), np.average(rows, weights=darkness)]
    # The square has 11.2 x 11.4 pixels at 128; samples of an edge place it to 1/4 of 1/2 pixel.
    np.testing.assert_allclose(seen, [50 + 700 * -0.2 / 12.5, 80 - 714 * 0.3 / 12.5], atol=0.07)
    assert darkness.sum() / 4 == pytest.approx(700 * 714 * (0.2 / 12.5) ** 2, rel=0.03)


def test_nearness_is_told_from_the_origin():
    wall = Mesh([[-9, -9, 0], [9, -9, 0], [0, 9, 0]], [[0, 1, 2]], [[9, 9, 9]])
    for view in (FAR_AWAY, FRONT):
        coverage, nearness, *normal = surface_maps(wall, [view])[0][:, 64, 64]
        np.testing.assert_allclose([coverage, nearness, *normal], [1, 0.625, 0, 0, 1], atol=1e-6)
