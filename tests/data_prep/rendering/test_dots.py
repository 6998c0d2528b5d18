from __future__ import annotations

import numpy as np

from data_prep.rendering.dots import FAR_GREY, MOST_DOTS, NEAR_GREY, draw_dots
from data_prep.scene import View

FRONT = (View(0.0, 0.0),)  # the camera at (0, 0, -4); its right is -X


def dots(points, views=FRONT):
    return draw_dots(np.array(points, np.float32).reshape(-1, 3), views)


def drawn(image):
    """Row, column and grey of all dots."""
    where = np.argwhere((image < 255).all(axis=2))
    return [(row, column, image[row, column, 0]) for row, column in where.tolist()]


def test_a_dot_is_where_the_camera_sees_its_point():
    """232 px of focal length; a point of depth 4 and 0.5 to the right is at 64 + 29 px. From
    behind, right is +X."""
    images = dots([[-0.5, 0.25, 0.0]], (*FRONT, View(180.0, 0.0)))
    assert images.shape == (2, 128, 128, 3)
    row = int(64 - 0.25 * 58)
    assert [drawn(image) for image in images] == [[(row, 93, 105)], [(row, 35, 105)]]


def test_nearer_is_darker_and_hides_what_lies_behind():
    (nearest,), (farthest,) = (drawn(dots([[0, 0, z]])[0]) for z in (-1, 1))
    assert (nearest[2], farthest[2]) == (NEAR_GREY, FAR_GREY)
    for order in (1, -1):
        (both,) = drawn(dots([[0, 0, -1], [0, 0, 1]][::order])[0])
        assert both[2] == NEAR_GREY


def test_what_cannot_be_seen_is_left_out():
    points = [[np.nan, 0, 0], [0, np.inf, 0], [0, 0, -5], [0, 0, -4], [1.5, 0, 0], [0, -1.5, 0]]
    assert (dots(points) == 255).all()
    assert (dots([]) == 255).all()


def test_of_many_points_some_are_shown_the_same_each_time():
    """Points on a grid of pixels, each visible; then one more than there may be."""
    rows, columns = np.divmod(np.arange(MOST_DOTS + 1), 120)
    plane = np.stack([(columns - 60 + 0.5) / 58, (rows - 60 + 0.5) / 58, 0 * rows], axis=1)
    once = dots(plane)
    assert np.array_equal(once, dots(plane))
    assert len(drawn(once[0])) == len(drawn(dots(plane[:-1])[0])) == MOST_DOTS
    assert np.array_equal(dots(plane[-2::-1]), dots(plane[:-1]))
