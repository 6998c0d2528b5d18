"""Images between their two forms: float32 in [0, 1] in memory, uint8 on disk and in metrics;
and ground truth from untrusted PNG files."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data_prep.failures import BadInput
from data_prep.files.safe_read import MIB, open_file
from data_prep.scene import IMAGE_SIZE, Images

MOST_BYTES = 4 * MIB  # of a PNG; 128 x 128 RGBA without compression are 64 KiB
_MODES = ("RGBA", "RGB", "LA", "L", "P")  # 8 bits a channel


def to_uint8(images: Images) -> NDArray[np.uint8]:
    """[0, 1] to 0..255, rounded half up (as the original's PNG writer); values outside are clipped.

    NaN has no place on this scale: the caller checks for it first.
    """
    return np.floor(np.clip(images, 0.0, 1.0) * np.float32(255.0) + np.float32(0.5)).astype(
        np.uint8
    )


def to_float(images: NDArray[np.uint8]) -> Images:
    """0..255 to float32 in [0, 1]; `to_uint8` takes it back exactly."""
    return images.astype(np.float32) / np.float32(255.0)


def blank(count: int) -> NDArray[np.uint8]:
    """`count` images of the white background, uint8 [count, IMAGE_SIZE, IMAGE_SIZE, 3]."""
    return np.full((count, IMAGE_SIZE, IMAGE_SIZE, 3), 255, dtype=np.uint8)


def read_image(path: Path) -> tuple[NDArray[np.uint8], str]:
    """uint8 [IMAGE_SIZE, IMAGE_SIZE, 3] on white, and the mode of the file ("RGBA").

    Composited as the original does (roatienza/pc2pix@46795a46, loader.py), colour times alpha plus
    white times one minus alpha, and rounded half up to uint8. Raises BadInput, naming the file, for
    what is no PNG, has another size, more than 8 bits a channel, or is cut short.
    """
    from PIL import Image

    with open_file(path, MOST_BYTES) as file, warnings.catch_warnings():
        warnings.simplefilter("error")  # of images that grow out of all bounds
        try:
            with Image.open(file, formats=("PNG",)) as image:
                size, mode = image.size, image.mode
                if size == (IMAGE_SIZE, IMAGE_SIZE) and mode in _MODES:
                    rgba = np.asarray(image.convert("RGBA"), np.float64)
                else:
                    rgba = None
        except Exception as error:  # Pillow raises whatever its parsers raise
            raise BadInput(f"{path}: not a readable PNG ({error}); fetch it again") from error
    if rgba is None:
        raise BadInput(
            f"{path}: {size[0]} x {size[1]} pixels of mode {mode}, expected {IMAGE_SIZE} x "
            f"{IMAGE_SIZE} of 8 bits a channel; scale or convert it"
        )
    alpha = rgba[..., 3:] / 255.0
    return np.floor(rgba[..., :3] * alpha + 255.0 * (1.0 - alpha) + 0.5).astype(np.uint8), mode
