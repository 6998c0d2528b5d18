"""Legs, rungs and spindles: does a picture draw the thin parts of an object, and only them?

SSIM hardly notices them, because they cover few pixels; the user of a picture does.

* Thin is what the true silhouette loses to a morphological opening by the disc of diameter 4: the
  12 pixels whose centres lie within 2 px of a pixel corner. A part that it does not fit into is
  thinner than 4 px. An even disc, because one about a pixel's centre cannot tell 3 px from 4; a
  disc, because the square of 4 px would also take diagonal parts up to 5 px from the silhouette
  (the disc: below 3.5 px; of lines in all directions it keeps those from 4 px on).
* An opening also rounds corners. What it takes there is a pixel or two, hence thin pixels count
  only in connected groups of at least 8: as much as the shortest stub, 2 x 4 px.
* `evaluated` (E) is all of the silhouette within 2 px of a thin pixel, edges and joints included.
* A pixel counts as drawn if its contrast to white is at least half of that of the true pixel, so
  that haze draws nothing. Contrast is 255 minus the mean of the channels: by the least channel a
  saturated colour would have more contrast than any grey can answer, and luma would let yellow
  vanish. Methods that do not know the colour draw in grey, and must not lose for it where the truth
  is dark: more contrast than that of the neutral grey (75) is not asked for, so that half of it, a
  pixel half covered by the lightest face of a grey reconstruction, is always enough. Where the
  truth is white there is nothing to halve, and the median of E stands in.

`recall` is the share of E that is drawn; `precision` the share of true silhouette among what is
drawn within 4 px of E, so that painting everything is not rewarded.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.foreground import contrast, foreground

Masks = NDArray[np.bool_]  # [N, H, W]

LEAST_GROUP = 8  # pixels
EVALUATED_WITHIN = 2  # pixels from a thin one
PRECISION_WITHIN = 4  # pixels from an evaluated one
MOST_ASKED = 75.0  # contrast of data_prep.mesh_files.NEUTRAL_GREY
# The disc of diameter 4 as offsets (row, column) of its 12 pixels from its upper left corner.
_DISC = tuple((y, x) for y in range(4) for x in range(4) if (y - 1.5) ** 2 + (x - 1.5) ** 2 <= 4)


class ThinScores(NamedTuple):
    """Float64 [N] each, 0..1, 1 is best; NaN where there is nothing to take a share of.

    recall     NaN for a true picture without thin parts
    precision  as recall, and where nothing is drawn beside a thin part
    """

    recall: NDArray[np.float64]
    precision: NDArray[np.float64]


def thin_scores(truth: NDArray[np.uint8], pictures: NDArray[np.uint8]) -> ThinScores:
    """Scores of pictures against the true ones, both uint8 [N, H, W, 3] on white.

    Raises ValueError where an array is not uint8 or not [N, H, W, C], and where the shapes differ.
    """
    for images in (truth, pictures):
        if images.dtype != np.uint8 or images.ndim != 4:
            found = f"{images.dtype} {list(images.shape)}"
            raise ValueError(f"images must be uint8 [N, H, W, C], got {found}")
    if truth.shape != pictures.shape:
        raise ValueError(f"pictures {list(pictures.shape)} of truths {list(truth.shape)}")
    part = evaluated(truth)
    recall = np.full(len(truth), np.nan)
    precision = np.full(len(truth), np.nan)
    for i in np.flatnonzero(part.any(axis=(1, 2))):
        shown = foreground(truth[i])
        true_contrast = contrast(truth[i])
        wanted = np.where(shown, true_contrast, np.median(true_contrast[part[i]]))
        drawn = contrast(pictures[i]) >= np.minimum(wanted, MOST_ASKED) / 2
        recall[i] = drawn[part[i]].mean()
        beside = drawn & _near(part[i], PRECISION_WITHIN)
        if beside.any():
            precision[i] = shown[beside].mean()
    return ThinScores(recall, precision)


def evaluated(truth: NDArray[np.uint8]) -> Masks:
    """E of true pictures uint8 [N, H, W, 3]: silhouette within 2 px of a thin pixel, [N, H, W]."""
    shown = foreground(truth)
    return _near(thin(shown), EVALUATED_WITHIN) & shown


def thin(silhouettes: Masks) -> Masks:
    """The pixels of silhouettes [N, H, W] that belong to parts thinner than 4 px."""
    from scipy.ndimage import label

    lost = silhouettes & ~_opened(silhouettes)
    for mask in lost:
        groups, _ = label(mask, np.ones((3, 3)))  # pixels that touch at a corner are connected
        sizes = np.bincount(groups.ravel())
        mask &= sizes[groups] >= LEAST_GROUP
    return lost


def _opened(masks: Masks) -> Masks:
    """Morphological opening of [N, H, W] by the disc; beyond the frame is background."""
    _, height, width = masks.shape
    padded = np.pad(masks, ((0, 0), (3, 3), (3, 3)))
    fits = np.ones((len(masks), height + 3, width + 3), np.bool_)  # by upper left corner
    for y, x in _DISC:
        fits &= padded[:, y : y + height + 3, x : x + width + 3]
    opened = np.zeros_like(padded)
    for y, x in _DISC:
        opened[:, y : y + height + 3, x : x + width + 3] |= fits
    return opened[:, 3:-3, 3:-3]


def _near(masks: Masks, radius: int) -> Masks:
    """The pixels of [..., H, W] whose centres are within `radius` px of one in the mask."""
    height, width = masks.shape[-2:]
    margin = [(0, 0)] * (masks.ndim - 2) + [(radius, radius)] * 2
    padded = np.pad(masks, margin)
    near = np.zeros_like(masks)
    for y in range(-radius, radius + 1):
        for x in range(-radius, radius + 1):
            if y * y + x * x <= radius * radius:
                top, left = radius + y, radius + x
                near |= padded[..., top : top + height, left : left + width]
    return near
