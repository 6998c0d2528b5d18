"""Where an image shows something, and how far the drawn silhouette covers the true one.

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
and parts inside do not count, so that a method that knows neither may score 1.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

WHITE = 255
MOST_ASKED = 75.0  # contrast of data_prep.mesh_files.NEUTRAL_GREY

Masks = NDArray[np.bool_]  # [N, H, W]


def foreground(images: NDArray[np.uint8]) -> Masks:
    """The pixels [N, H, W] that are not white, of uint8 [N, H, W, C]; edges count as a whole.

    Raises ValueError where the images are not uint8.
    """
    _require_uint8(images)
    shown = np.zeros(images.shape[:-1], np.bool_)
    for channel in range(images.shape[-1]):  # NumPy is slow along an axis of 3
        shown |= images[..., channel] < WHITE
    return shown


def contrast(images: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Contrast to white [N, H, W], 0..255: 255 minus the mean of the channels.

    Raises ValueError where the images are not uint8.
    """
    _require_uint8(images)
    total = np.zeros(images.shape[:-1], np.int32)
    for channel in range(images.shape[-1]):
        total += images[..., channel]
    return (WHITE - total / images.shape[-1]).astype(np.float32)


def drawn(truth: NDArray[np.uint8], images: NDArray[np.uint8], usual: Masks) -> Masks:
    """The pixels [N, H, W] where images draw something; both uint8 [N, H, W, C].

    usual  [N, H, W], a part of what the true images show; its median contrast is asked for where
           they are white (the neutral grey's, where the part is empty)

    Of a true image, drawn is all that it shows. Raises as `require_pairs`.
    """
    require_pairs(truth, images)
    shown, asked = foreground(truth), contrast(truth)
    for values, mask, some in zip(asked, shown, usual, strict=True):
        values[~mask] = np.median(values[some]) if some.any() else MOST_ASKED
    return contrast(images) >= np.minimum(asked, MOST_ASKED) / 2


def require_pairs(truth: NDArray[np.uint8], images: NDArray[np.uint8]) -> None:
    """Raises ValueError: an array is not uint8 or not [N, H, W, C], or the shapes differ."""
    for some in (truth, images):
        if some.dtype != np.uint8 or some.ndim != 4:
            found = f"{some.dtype} {list(some.shape)}"
            raise ValueError(f"images must be uint8 [N, H, W, C], got {found}")
    if truth.shape != images.shape:
        raise ValueError(f"pictures {list(images.shape)} of truths {list(truth.shape)}")


def object_boxes(truth: NDArray[np.uint8]) -> NDArray[np.intp]:
    """The box [N, (top, bottom, left, right)] of the foreground of each true image.

    In pixels, bottom and right exclusive; all 0 for a blank image.

    Raises ValueError where the images are not uint8 or not [N, H, W, C].
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


def _require_uint8(images: NDArray[np.uint8]) -> None:
    """On the scale 0..1 all is dark, and NaN is not: neither may pass for an image."""
    if images.dtype != np.uint8:
        found = f"{images.dtype} {list(images.shape)}"
        raise ValueError(f"images must be uint8 (range 0..255), got {found}")


def silhouette_iou(truth: NDArray[np.uint8], images: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Intersection over union of silhouettes [N], 0..1, of images against the true ones.

    Both uint8 [N, H, W, 3] on white. 1 for identical images and where neither shows anything: it
    always has a value. 0 where nothing is drawn of a true image that shows something, and the
    other way round. An image's value does not depend on its neighbours.

    Raises ValueError where an array is not uint8 or not [N, H, W, C], and where the shapes differ.
    """
    covered = drawn(truth, images, foreground(truth))
    shown = foreground(truth)
    both = np.count_nonzero(shown & covered, axis=(1, 2))
    either = np.count_nonzero(shown | covered, axis=(1, 2))
    return np.where(either == 0, 1.0, both / np.maximum(either, 1))
