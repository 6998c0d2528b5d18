"""Texts of a sheet stay within their tiles; `test_cloud` has its images."""

from __future__ import annotations

import numpy as np

from bench.draw.finish import (
    INK,
    LABEL_HEIGHT,
    MARGIN,
    PROBLEM_GROUND,
    PROBLEM_INK,
    Tile,
    draw_sheet,
)

TOP, STEP = MARGIN + LABEL_HEIGHT, 128 + MARGIN  # of the first image, and to the next tile
WHITE = np.full((1, 128, 128, 3), 255, np.uint8)


def test_a_label_is_over_its_own_image_only():
    (frame,) = draw_sheet([Tile("i" * 300, WHITE), Tile("", WHITE)], 2, 1)
    label = frame[MARGIN:TOP, MARGIN:STEP]
    assert (label.min(axis=(0, 1)) == INK).all()
    label[:] = 255
    assert (frame == 255).all()


def test_tiles_are_as_large_as_asked_and_smaller_images_get_larger_pixels():
    small = np.arange(4, dtype=np.uint8).reshape(1, 2, 2, 1).repeat(3, axis=3)
    large = np.arange(36, dtype=np.uint8).reshape(1, 6, 6, 1).repeat(3, axis=3)
    (frame,) = draw_sheet([Tile("", small), Tile("", large)], 2, 1, size=6)
    row = frame[TOP : TOP + 6, :, 0]
    assert (
        row[:, MARGIN : MARGIN + 6] == [[0, 0, 0, 1, 1, 1]] * 3 + [[2, 2, 2, 3, 3, 3]] * 3
    ).all()
    assert (row[:, 2 * MARGIN + 6 : 2 * MARGIN + 12] == large[0, :, :, 0]).all()


def test_labels_grow_with_large_tiles():
    large = np.full((1, 512, 512, 3), 255, np.uint8)
    (frame,) = draw_sheet([Tile("Mg", large)], 1, 1, size=512)
    assert frame.shape == (512 + 2 * LABEL_HEIGHT + 2 * MARGIN, 512 + 2 * MARGIN, 3)
    rows = (frame[MARGIN : MARGIN + 2 * LABEL_HEIGHT] < 255).any(axis=(1, 2))
    assert rows.sum() > LABEL_HEIGHT  # higher than letters of the usual size can be


def test_a_long_reason_stays_in_place_of_its_image():
    (frame,) = draw_sheet([Tile("", "stage: " + 500 * "points and holes "), Tile("", WHITE)], 2, 1)
    message = frame[TOP : TOP + 128, MARGIN:STEP]
    assert (message.reshape(-1, 3) == PROBLEM_INK).all(axis=1).any()
    message[MARGIN:-MARGIN, MARGIN:-MARGIN] = PROBLEM_GROUND
    assert (message == PROBLEM_GROUND).all()
    message[:] = 255
    assert (frame == 255).all()
