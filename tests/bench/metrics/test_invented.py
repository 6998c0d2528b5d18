"""Invented holes and parts by images made by hand, whose pixels are counted in the drawing."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from bench.metrics.invented import invented_holes, invented_parts

SIDE = 64
GREY = 80
NOWHERE = np.zeros((SIDE, SIDE), bool)
EVERYWHERE = ~NOWHERE


def box(top, bottom, left, right):
    mask = NOWHERE.copy()
    mask[top:bottom, left:right] = True
    return mask


def image(mask, level=GREY):
    return np.where(mask, level, 255).astype(np.uint8)[None, :, :, None].repeat(3, axis=-1)


def staircase(count):
    """Pixels inside the object that touch at corners alone."""
    mask = NOWHERE.copy()
    mask[range(20, 20 + count), range(20, 20 + count)] = True
    return mask


OBJECT = box(10, 50, 10, 50)
HOLE_19 = box(20, 21, 20, 39)
HOLE_20 = box(20, 21, 20, 40)
ALONG_THE_EDGE = {edge: OBJECT & ~box(edge, 50, 10, 50) for edge in (12, 13)}
HOLES = {  # true silhouette, drawn one, pixels of holes
    "the object itself": (OBJECT, OBJECT, 0),
    "19 px": (OBJECT, OBJECT & ~HOLE_19, 0),
    "20 px": (OBJECT, OBJECT & ~HOLE_20, 20),
    "two of 19 px": (OBJECT, OBJECT & ~HOLE_19 & ~box(30, 31, 20, 39), 0),
    "one of 19 px and one of 20": (OBJECT, OBJECT & ~HOLE_20 & ~box(30, 31, 20, 39), 20),
    "19 px, connected at corners": (OBJECT, OBJECT & ~staircase(19), 0),
    "20 px, connected at corners": (OBJECT, OBJECT & ~staircase(20), 20),
    # Of a row of 40 those are inside that are as far from both ends of it: 36.
    "the two rows at the edge": (OBJECT, OBJECT & ~ALONG_THE_EDGE[12], 0),
    "the three rows at the edge": (OBJECT, OBJECT & ~ALONG_THE_EDGE[13], 36),
    # Its first two pixels are not inside.
    "a tear of 21 px from the edge": (OBJECT, OBJECT & ~box(10, 31, 30, 31), 0),
    "a tear of 22 px from the edge": (OBJECT, OBJECT & ~box(10, 32, 30, 31), 20),
    "nothing is drawn": (OBJECT, NOWHERE, 36 * 36),
    "nothing to draw": (NOWHERE, NOWHERE, 0),
    "all of the frame for nothing": (NOWHERE, EVERYWHERE, 0),
    "an object cut by the frame": (box(0, 20, 0, SIDE), NOWHERE, 16 * (SIDE - 4)),
    "an object that fills the frame": (EVERYWHERE, NOWHERE, (SIDE - 4) ** 2),
    "a true hole": (OBJECT & ~HOLE_20, OBJECT & ~HOLE_20, 0),
    "too thin for an inside": (box(10, 50, 30, 34), NOWHERE, 0),
}
PARTS = {  # true silhouette, drawn one, pixels of parts
    "the object itself": (OBJECT, OBJECT, 0),
    "19 px": (OBJECT, OBJECT | box(55, 56, 20, 39), 0),
    "20 px": (OBJECT, OBJECT | box(55, 56, 20, 40), 20),
    "two rows more": (OBJECT, OBJECT | box(50, 52, 10, 50), 0),
    "three rows more": (OBJECT, OBJECT | box(50, 53, 10, 50), 40),
    # From the corner (49, 49) its first pixel is 2.83 px away, so that 19 are outside; then all 20.
    "a part at the corner": (OBJECT, OBJECT | box(51, 55, 51, 56), 0),
    "farther from the corner": (OBJECT, OBJECT | box(52, 56, 51, 56), 20),
    "at the frame": (OBJECT, OBJECT | box(SIDE - 1, SIDE, 0, 20), 20),
    "nothing is drawn": (OBJECT, NOWHERE, 0),
    "nothing to draw": (NOWHERE, NOWHERE, 0),
    "a part for nothing": (NOWHERE, HOLE_20, 20),
    "all of the frame for nothing": (NOWHERE, EVERYWHERE, SIDE * SIDE),
    "a true hole that is filled": (OBJECT & ~box(20, 40, 20, 40), OBJECT, 16 * 16),
    "a true gap of 4 px that is filled": (OBJECT & ~box(10, 50, 28, 32), OBJECT, 0),
}


@pytest.mark.parametrize("name", HOLES)
def test_holes(name):
    true, drawn, pixels = HOLES[name]
    assert invented_holes(image(true), image(drawn)).tolist() == [pixels]


@pytest.mark.parametrize("name", PARTS)
def test_parts(name):
    true, drawn, pixels = PARTS[name]
    assert invented_parts(image(true), image(drawn)).tolist() == [pixels]


def test_a_white_object_is_drawn_by_as_little_contrast():
    """Contrast 4 asks for 2; a wholly white object shows nothing, and what is drawn is invented."""
    true = image(OBJECT, 251)
    hole = OBJECT & ~HOLE_20
    assert invented_holes(true, image(hole, 253)).tolist() == [20]
    assert invented_holes(true, image(hole, 254)).tolist() == [36 * 36]
    far = box(55, 57, 20, 40)
    assert invented_parts(true, image(far, 253)).tolist() == [40]
    assert invented_parts(true, image(far, 254)).tolist() == [0]
    assert invented_holes(image(OBJECT, 255), image(NOWHERE)).tolist() == [0]
    assert invented_parts(image(OBJECT, 255), image(HOLE_20)).tolist() == [20]


def test_haze_is_neither_drawn_nor_a_part():
    """A dark object asks for contrast 37.5, half of the neutral grey's."""
    for level, holes, parts in ((218, 36 * 36, 0), (217, 0, SIDE * SIDE - 44 * 44)):
        hazed = image(EVERYWHERE, level)
        assert invented_holes(image(OBJECT), hazed).tolist() == [holes]
        assert invented_parts(image(OBJECT), hazed).tolist() == [parts]


def test_counts_agree_with_distances():
    """Pixels by their distance from the silhouette, on blobs that touch the frame, each alone."""
    rng = np.random.default_rng(0)
    noise = ndimage.gaussian_filter(rng.standard_normal((2, 6, SIDE, SIDE)), (0, 0, 4, 4))
    true, drawn = noise > 0.02
    expected = {invented_holes: [], invented_parts: []}
    for silhouette, shown in zip(true, drawn, strict=True):
        padded = np.pad(silhouette, 4)
        to_white, to_object = map(ndimage.distance_transform_edt, (padded, ~padded))
        inside, outside = ((d >= 3)[4:-4, 4:-4] for d in (to_white, to_object))
        for metric, wrong in ((invented_holes, inside & ~shown), (invented_parts, outside & shown)):
            groups, count = ndimage.label(wrong, np.ones((3, 3)))
            sizes = [(groups == group).sum() for group in range(1, count + 1)]
            expected[metric].append(sum(size for size in sizes if size >= 20))
    pair = [np.concatenate([*map(image, masks)]) for masks in (true, drawn)]
    for metric, pixels in expected.items():
        assert sum(pixels) > 0
        assert metric(*pair).tolist() == pixels
