"""The images that metrics take: arrays of bytes, a stack of images with the channels last."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_CHANNELS = (1, 3, 4)  # grey; red, green and blue; the same with opacity


def require_bytes(*stacks: NDArray[np.uint8]) -> None:
    """Raise ValueError for anything but arrays of uint8, whatever their shape.

    Images of floats in 0..1 would be taken as dark all over, and NaN as no foreground.
    """
    for images in stacks:
        if not isinstance(images, np.ndarray):
            kind = f"{type(images).__module__}.{type(images).__name__}".removeprefix("builtins.")
            raise ValueError(
                f"images must be NumPy arrays uint8 [N, H, W, C], got a {kind}; "
                "numpy.asarray makes an array of a picture of PIL"
            )
        if images.dtype != np.uint8:
            raise ValueError(f"images must be uint8 (range 0..255), got {_described(images)}")


def require_channels_last(images: NDArray[np.uint8]) -> None:
    """Raise ValueError unless the last axis has as many entries as images have channels."""
    if images.ndim == 0 or images.shape[-1] not in _CHANNELS:
        raise ValueError(
            f"images must be [N, H, W, C] with C of 1, 3 or 4, got {_described(images)}; the "
            "channels come last"
        )


def require_pairs(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> None:
    """Raise ValueError unless both arrays are uint8 [N, H, W, C] of one shape, with pixels."""
    require_bytes(a, b)
    shapes = f"{_described(a)} and {_described(b)}"
    if a.ndim != 4 or b.ndim != 4:
        raise ValueError(f"images must be [N, H, W, C], got {shapes}")
    require_same_shape(a, b)
    if 0 in a.shape[1:]:
        raise ValueError(f"nothing to compare, got {shapes}")
    require_channels_last(a)


def require_same_shape(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> None:
    """Raise ValueError where two stacks differ in shape."""
    if a.shape != b.shape:
        shapes = f"{_described(a)} and {_described(b)}"
        raise ValueError(f"stacks of images must have the same shape, got {shapes}")


def require_some(images: NDArray[np.uint8]) -> None:
    """Raise ValueError for a stack of no images."""
    if not len(images):
        raise ValueError(f"nothing to compare, got {_described(images)}")


def require_rgb(images: NDArray[np.uint8], least: int = 0) -> None:
    """Raise ValueError for anything but uint8 [N, H, W, 3], and for a side below `least` px."""
    require_bytes(images)
    if images.ndim != 4 or images.shape[3] != 3:
        raise ValueError(
            f"images must be uint8 [N, H, W, 3], the channels last, got {_described(images)}"
        )
    if min(images.shape[1:3]) < least:
        raise ValueError(
            f"images must be of {least} x {least} pixels or more, got {_described(images)}"
        )


def are_two_images(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> bool:
    """Return whether both arrays are single images [H, W, C], and no stacks.

    An array of three axes whose last is longer than 4 is taken for a stack of grey images. Raises
    ValueError as `require_bytes`.
    """
    require_bytes(a, b)
    return a.ndim == b.ndim == 3 and a.shape[-1] <= 4


def _described(images: NDArray[np.uint8]) -> str:
    return f"{images.dtype} {list(images.shape)}"
