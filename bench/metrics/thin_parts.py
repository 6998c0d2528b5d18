"""Recall and precision of thin parts in an image: legs, rungs and spindles.

SSIM hardly notices them, because they cover few pixels; the user of an image does.

* Thin is what the true silhouette loses to a morphological opening by the disc of diameter 4: the
  12 pixels whose centres lie within 2 px of a pixel corner. A part that it does not fit into is
  thinner than 4 px. An even disc, because one about a pixel's centre cannot tell 3 px from 4; a
  disc, because the square of 4 px would also take diagonal parts up to 5 px from the silhouette
  (the disc: below 3.5 px; of lines in all directions it keeps those from 4 px on).
* An opening also rounds corners. What it takes there is a pixel or two, hence thin pixels count
  only in connected groups of at least 8: as much as the shortest stub, 2 x 4 px.
* `evaluated` (E) is all of the silhouette within 2 px of a thin pixel, edges and joints included.
* What counts as drawn, and that haze does not, is said in `bench.metrics.silhouette`; the median
  that stands in where the truth is white is that of E.

`recall` is the share of E that is drawn; `precision` the share of true silhouette among what is
drawn within 4 px of E, so that painting everything is not rewarded.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.metrics.silhouette import Masks, Pairs, foreground, large_groups

_LEAST_GROUP = 8  # thin pixels that have to be connected: the shortest stub, 2 x 4 px
_EVALUATED_WITHIN = 2  # px: the silhouette so near to a thin pixel is evaluated
_PRECISION_WITHIN = 4  # px: the precision is of what is drawn so near to an evaluated pixel
# The disc of diameter 4: the square of 4 px around it without its corners.
_DISC = np.array([[0, 1, 1, 0], [1, 1, 1, 1], [1, 1, 1, 1], [0, 1, 1, 0]], np.bool_)


class _ThinScores(NamedTuple):
    """The scores, float64 [N] each, 0..1, 1 is best.

    recall     NaN for a true image without thin parts
    precision  NaN for a true image without thin parts, and where nothing is drawn near them
    """

    recall: NDArray[np.float64]
    precision: NDArray[np.float64]


def thin_scores(pairs: Pairs) -> _ThinScores:
    """Return how well the drawn images have the thin parts of the true ones."""
    part = _evaluated(pairs.shown)
    recall = np.full(len(part), np.nan)
    precision = np.full(len(part), np.nan)
    with_thin_parts = np.flatnonzero(part.any(axis=(1, 2)))
    drawn = pairs.drawn(part)
    near = _near(part[with_thin_parts], _PRECISION_WITHIN)
    for i, drawn_near in zip(with_thin_parts, drawn[with_thin_parts] & near, strict=True):
        recall[i] = drawn[i][part[i]].mean()
        if drawn_near.any():
            precision[i] = pairs.shown[i][drawn_near].mean()
    return _ThinScores(recall, precision)


def evaluated(truth: NDArray[np.uint8]) -> Masks:
    """Return the pixels [N, H, W] that are evaluated in true images uint8 [N, H, W, 3].

    They are the pixels of the silhouette within 2 px of a thin one.
    """
    return _evaluated(foreground(truth))


def _evaluated(shown: Masks) -> Masks:
    return _near(thin(shown), _EVALUATED_WITHIN) & shown


def thin(silhouettes: Masks) -> Masks:
    """Return the pixels of silhouettes [N, H, W] that belong to parts thinner than 4 px."""
    return large_groups(silhouettes & ~_opened(silhouettes), _LEAST_GROUP)


def _opened(masks: Masks) -> Masks:
    """Return the opening of masks [N, H, W] by the disc; beyond the frame is background."""
    flat, inner, width = _flattened(masks, 3)
    offsets = [y * width + x for y, x in np.argwhere(_DISC).tolist()]  # of its 12 pixels
    corners = max(flat.size - max(offsets), 0)  # 0 where there are no masks
    # Whether the disc fits into a mask, by the upper left corner of the square around it.
    fits = np.ones(corners, np.bool_)
    for offset in offsets:
        fits &= flat[offset : offset + corners]
    opened = np.zeros_like(flat)
    for offset in offsets:
        opened[offset : offset + corners] |= fits
    return inner(opened)


def _near(masks: Masks, radius: int) -> Masks:
    """Return the pixels [N, H, W] whose centres are within `radius` px of that of one in a mask."""
    flat, inner, width = _flattened(masks, radius)
    near = np.zeros_like(flat)
    margin = radius * width + radius
    middle = near[margin : near.size - margin]
    for y in range(-radius, radius + 1):
        for x in range(-radius, radius + 1):
            if y * y + x * x <= radius * radius:
                first = margin + y * width + x
                middle |= flat[first : first + middle.size]
    return inner(near)


def _flattened(masks: Masks, margin: int) -> tuple[Masks, Callable[[Masks], Masks], int]:
    """Return masks, each with a margin of background, as one long row, which NumPy is fast at.

    The other two are the function that makes masks [N, H, W] of such a row, and the number of its
    pixels in one line of a mask. A step of up to `margin` px in any direction is a step along the
    row: from the end of a line it leads into a margin, not into the next line.
    """
    padded = np.pad(masks, ((0, 0), (margin, margin), (margin, margin)))

    def inner(flat: Masks) -> Masks:
        return flat.reshape(padded.shape)[:, margin:-margin, margin:-margin]

    return padded.ravel(), inner, padded.shape[2]
