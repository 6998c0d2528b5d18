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

_LEAST_GROUP = 8  # pixels
_EVALUATED_WITHIN = 2  # pixels from a thin one
_PRECISION_WITHIN = 4  # pixels from an evaluated one
# The disc of diameter 4 as offsets (row, column) of its 12 pixels from its upper left corner.
_DISC = tuple((y, x) for y in range(4) for x in range(4) if (y - 1.5) ** 2 + (x - 1.5) ** 2 <= 4)


class _ThinScores(NamedTuple):
    """The scores, float64 [N] each, 0..1, 1 is best; NaN for a share of nothing.

    recall     NaN for a true image without thin parts
    precision  as recall, and where nothing is drawn beside a thin part
    """

    recall: NDArray[np.float64]
    precision: NDArray[np.float64]


def thin_scores(pairs: Pairs) -> _ThinScores:
    """Return scores of images against the true ones."""
    part = _evaluated(pairs.shown)
    recall = np.full(len(part), np.nan)
    precision = np.full(len(part), np.nan)
    thinned = np.flatnonzero(part.any(axis=(1, 2)))
    drawn = pairs.drawn(part)
    near = _near(part[thinned], _PRECISION_WITHIN)
    for i, beside in zip(thinned, drawn[thinned] & near, strict=True):
        recall[i] = drawn[i][part[i]].mean()
        if beside.any():
            precision[i] = pairs.shown[i][beside].mean()
    return _ThinScores(recall, precision)


def evaluated(truth: NDArray[np.uint8]) -> Masks:
    """Return E of true images uint8 [N, H, W, 3]: silhouette within 2 px of a thin pixel.

    The mask is [N, H, W].
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
    offsets = [y * width + x for y, x in _DISC]
    n = max(flat.size - max(offsets), 0)  # 0: there are no masks
    fits = np.ones(n, np.bool_)  # by upper left corner
    for offset in offsets:
        fits &= flat[offset : offset + n]
    opened = np.zeros_like(flat)
    for offset in offsets:
        opened[offset : offset + n] |= fits
    return inner(opened)


def _near(masks: Masks, radius: int) -> Masks:
    """Return the pixels of [N, H, W] whose centres are within `radius` px of one in the mask."""
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
    """Return masks with a margin of background as one long row, the way back, and its pitch.

    A step of up to `margin` px in any direction is then one along the row, from any pixel: at the
    end of a line it ends in a margin. Long rows are what NumPy is fast at.
    """
    padded = np.pad(masks, ((0, 0), (margin, margin), (margin, margin)))

    def inner(flat: Masks) -> Masks:
        return flat.reshape(padded.shape)[:, margin:-margin, margin:-margin]

    return padded.ravel(), inner, padded.shape[2]
