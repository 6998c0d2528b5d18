"""The silhouette of an image, and the overlap of the drawn one with the true one.

White is background, by the conventions of all images. A true image shows something wherever it
is not white; its edges, which cover a pixel in part, count as a whole. Of a drawn image that
would be too much: a network's background is white but for a few levels, and all of the frame would
be object. So a pixel counts as `drawn` if its contrast to white is at least half of that of the
true pixel, and haze draws nothing.

Contrast is 255 minus the mean of the channels: by the least channel a saturated colour would have
more contrast than any grey can answer, and luma would let yellow vanish. Methods that do not know
the colour draw in grey, and must not lose for it where the truth is dark: more contrast than that
of the neutral grey (75) is not asked for, so that half of it, a pixel half covered by the lightest
face of a grey reconstruction, is always enough. Where the truth is white there is nothing to halve,
and the median contrast of what it shows stands in.

The score is the intersection over union (Jaccard 1912) of the two sets of pixels. Colour, shading
and parts inside do not count, so that a method that knows neither may have the best.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bench.metrics.image_arrays import require_bytes, require_channels_last, require_pairs

WHITE = 255  # level of every channel of the background
# The most contrast to white that is asked for: that of the neutral grey of objects without colours
# (data_prep.files.meshes.NEUTRAL_GREY).
MOST_ASKED = 75.0

Masks = NDArray[np.bool_]  # [N, H, W]


def foreground(images: NDArray[np.uint8]) -> Masks:
    """Return the pixels [N, H, W] that are not white, of uint8 [N, H, W, C].

    Pixels of an edge count as a whole. Raises ValueError for arrays of another type or shape.
    """
    require_bytes(images)
    require_channels_last(images)
    shown = np.zeros(images.shape[:-1], np.bool_)
    for channel in range(images.shape[-1]):  # NumPy is slow along an axis of 3
        shown |= images[..., channel] < WHITE
    return shown


def contrast(images: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Return the contrast to white [N, H, W], 0..255: 255 minus the mean of the channels.

    Raises ValueError for arrays of another type or shape.
    """
    require_bytes(images)
    require_channels_last(images)
    total = np.zeros(images.shape[:-1], np.int32)
    for channel in range(images.shape[-1]):
        total += images[..., channel]
    return (WHITE - total / images.shape[-1]).astype(np.float32)


class Pairs:
    """Pairs of a true image and a drawn one, uint8 [N, H, W, C] each, with their silhouettes.

    shown  the pixels [N, H, W] that are not white in the true images

    Raises ValueError where an array is not uint8 or not [N, H, W, C], where the shapes differ, and
    where images have no pixels.
    """

    def __init__(self, truth: NDArray[np.uint8], images: NDArray[np.uint8]) -> None:
        require_pairs(truth, images)
        self.shown = foreground(truth)
        self._true_contrast, self._drawn_contrast = contrast(truth), contrast(images)

    def drawn(self, usual: Masks) -> Masks:
        """Return the pixels [N, H, W] where the drawn images show something.

        usual  pixels [N, H, W], a part of `shown`: their median contrast is asked for where the
               true image is white; where there are none, the contrast of the neutral grey

        By this rule a true image draws all that it shows.
        """
        asked = self._true_contrast.copy()
        for values, shown, part in zip(asked, self.shown, usual, strict=True):
            values[~shown] = np.median(values[part]) if part.any() else MOST_ASKED
        return self._drawn_contrast >= np.minimum(asked, MOST_ASKED) / 2


def object_boxes(truth: NDArray[np.uint8]) -> NDArray[np.intp]:
    """Return the box (top, bottom, left, right) around the object in each true image, [N, 4].

    In pixels; bottom and right are the first row and column beyond the object. All are 0 for a
    blank image. Raises ValueError where the images are not uint8 or not [N, H, W, C].
    """
    shown = foreground(truth)
    if truth.ndim != 4:
        raise ValueError(f"images must be [N, H, W, C], got {truth.dtype} {list(truth.shape)}")
    boxes = np.zeros((len(shown), 4), np.intp)
    for box, mask in zip(boxes, shown, strict=True):
        rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
        if len(rows):
            box[:] = rows[0], rows[-1] + 1, columns[0], columns[-1] + 1
    return boxes


def overlap(a: Masks, b: Masks) -> NDArray[np.float64]:
    """Return the intersection over union [N] of masks [N, H, W]; 1 where both are empty."""
    both = np.count_nonzero(a & b, axis=(1, 2))
    either = np.count_nonzero(a | b, axis=(1, 2))
    return np.where(either == 0, 1.0, both / np.maximum(either, 1))


def large_groups(masks: Masks, least: int) -> Masks:
    """Return the pixels of masks [N, H, W] in connected groups of at least `least` pixels."""
    from scipy.ndimage import label

    large = masks.copy()
    for mask in large:
        groups, _ = label(mask, np.ones((3, 3)))  # pixels that touch at a corner are connected
        sizes = np.bincount(groups.ravel())
        mask &= sizes[groups] >= least
    return large
