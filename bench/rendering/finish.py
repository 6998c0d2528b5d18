"""Images at another size, and without their white background. Pure: arrays to arrays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from data_prep.scene import UInt8Images

LEAST_SIZE, MOST_SIZE = 16, 2048
_BACKGROUND = 8 / 255  # less dark is background: networks draw it a little off white
_EDGE_PX = 2  # the smoothed edges of networks; those of meshes take one


def resized(images: NDArray[np.uint8], size: int) -> NDArray[np.uint8]:
    """Return images [F, H, W, 3] as [F, size, size, 3], by Lanczos' filter."""
    from PIL import Image

    lanczos = Image.Resampling.LANCZOS
    return np.stack(
        [np.asarray(Image.fromarray(image).resize((size, size), lanczos)) for image in images]
    )


def without_background(images: UInt8Images, size: int) -> NDArray[np.uint8]:
    """Return images on white, [F, S, S, 3], as RGBA [F, size, size, 4] that are the same on white.

    White is transparent, the object opaque. Within _EDGE_PX of the background a pixel is as opaque
    as it is dark, compared with the object beside it. Its colour is the one that on white gives
    the pixel of the opaque image (of `resized`) again, within a grey level.
    """
    from PIL import Image

    large = resized(images, size)
    opacity = np.stack([_opacity(image) for image in images]).astype(np.float32)
    if opacity.shape[1:] != large.shape[1:3]:
        lanczos = Image.Resampling.LANCZOS
        enlarged = [Image.fromarray(o).resize((size, size), lanczos) for o in opacity]
        opacity = np.stack([np.asarray(o) for o in enlarged])
    # Less opaque than dark, a pixel would need a colour darker than black.
    opacity = np.clip(opacity, _darkness(large), 1.0)
    steps = np.ceil(opacity * 255 - 1e-3)[..., None]  # up, for the same reason
    alpha = steps / 255
    colour = np.full(large.shape, 255.0)
    np.divide(large - 255 * (1 - alpha), alpha, out=colour, where=alpha > 0)
    rgb = np.floor(np.clip(colour, 0, 255) + 0.5)
    return np.concatenate([rgb, steps], axis=3).astype(np.uint8)


def _darkness(images: NDArray[np.uint8]) -> NDArray[np.float64]:
    return 1 - images.min(axis=-1) / 255


def _opacity(image: NDArray[np.uint8]) -> NDArray[np.float64]:
    from scipy.ndimage import maximum_filter, minimum_filter, uniform_filter

    darkness, around = _darkness(image), 2 * _EDGE_PX + 1
    within = minimum_filter(darkness, around) >= _BACKGROUND
    # The object beside an edge is what is near of its inside; a thin part has none near by, and is
    # measured by its darkest pixel.
    share = uniform_filter(within.astype(float), 2 * around - 1)
    inside = uniform_filter(darkness * within, 2 * around - 1) / np.maximum(share, 1e-9)
    beside = np.where(share > 1e-9, inside, maximum_filter(darkness, around))
    edge = np.minimum(darkness / np.maximum(beside, _BACKGROUND), 1.0)
    return np.where(within, 1.0, np.where(darkness < _BACKGROUND, darkness, edge))
