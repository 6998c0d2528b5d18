from __future__ import annotations

import numpy as np
import pytest

from bench.rendering.sheet import (
    LABEL_HEIGHT,
    MARGIN,
    PROBLEM_GROUND,
    PROBLEM_INK,
    Tile,
    draw_sheet,
)

STEP = 128 + MARGIN  # to the next tile, unscaled


def plain(*greys):
    """A frame of each of these greys."""
    return np.repeat(np.array(greys, np.uint8), 128 * 128 * 3).reshape(-1, 128, 128, 3)


def image_at(frame, row, column, scale=1):
    side = scale * 128
    top = MARGIN + row * (side + LABEL_HEIGHT + MARGIN) + LABEL_HEIGHT
    left = MARGIN + column * (side + MARGIN)
    return frame[top : top + side, left : left + side]


def label_at(frame, row, column):
    top = MARGIN + row * (STEP + LABEL_HEIGHT)
    return frame[top : top + LABEL_HEIGHT, MARGIN + column * STEP :][:, :128]


def test_tiles_stand_row_by_row_with_white_between():
    frames = draw_sheet([Tile("", plain(10)), Tile("", plain(20)), Tile("", plain(30))], 2, 1)
    assert frames.shape == (1, MARGIN + 2 * (STEP + LABEL_HEIGHT), MARGIN + 2 * STEP, 3)
    for place, grey in (((0, 0), 10), ((0, 1), 20), ((1, 0), 30), ((1, 1), 255)):
        assert (image_at(frames[0], *place) == grey).all()
    assert (frames < 255).all(axis=3).sum() == 3 * 128 * 128


def test_every_frame_shows_its_images():
    moving, other = plain(1, 2, 3), plain(4, 5, 6)
    frames = draw_sheet([Tile("a", moving), Tile("b", other)], 2, 1)
    assert [image_at(f, 0, 0)[0, 0, 0] for f in frames] == [1, 2, 3]
    assert [image_at(f, 0, 1)[0, 0, 0] for f in frames] == [4, 5, 6]
    assert (label_at(frames[0], 0, 1) == label_at(frames[2], 0, 1)).all()


def test_a_reason_stands_in_place_of_the_images_in_every_frame():
    """A long one, too: what has no room is left out."""
    reason = "stage: " + 500 * "points and holes "
    frames = draw_sheet([Tile("", reason), Tile("", plain(7, 8))], 2, 1)
    message = image_at(frames[0], 0, 0)
    assert (frames[1][:, : MARGIN + STEP] == frames[0][:, : MARGIN + STEP]).all()
    assert (message[0, 0] == PROBLEM_GROUND).all()
    assert (message.reshape(-1, 3) == PROBLEM_INK).all(axis=1).any()
    framed = message.copy()
    framed[MARGIN:-MARGIN, MARGIN:-MARGIN] = PROBLEM_GROUND
    assert (framed == PROBLEM_GROUND).all()
    assert image_at(frames[1], 0, 1)[0, 0, 0] == 8


def test_how_many_frames_there_are():
    assert len(draw_sheet([Tile("a", "x: y"), Tile("b", "")], 2, 1)) == 1
    with pytest.raises(ValueError, match=r"tiles have \[1, 2\] frames"):
        draw_sheet([Tile("", plain(1)), Tile("", plain(1, 2))], 2, 1)
