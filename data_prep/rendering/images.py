"""Images as float32 in [0, 1] and as uint8, and true images from untrusted PNG files."""

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
    """Convert images to 8 bits, rounded half up as in the original's PNG writer.

    Parameters
    ----------
    images : float32 array
        Values in [0, 1]; others are clipped. The caller has to check for NaN.

    Returns
    -------
    uint8 array
        Values in 0..255, in the same shape.
    """
    return np.floor(np.clip(images, 0.0, 1.0) * np.float32(255.0) + np.float32(0.5)).astype(
        np.uint8
    )


def to_float(images: NDArray[np.uint8]) -> Images:
    """Convert images to floating-point numbers; `to_uint8` restores them exactly.

    Parameters
    ----------
    images : uint8 array
        Values in 0..255.

    Returns
    -------
    float32 array
        Values in [0, 1], in the same shape.
    """
    return images.astype(np.float32) / np.float32(255.0)


def blank(count: int) -> NDArray[np.uint8]:
    """Return white images, uint8 [count, IMAGE_SIZE, IMAGE_SIZE, 3]."""
    return np.full((count, IMAGE_SIZE, IMAGE_SIZE, 3), 255, dtype=np.uint8)


def read_image(path: Path) -> tuple[NDArray[np.uint8], str]:
    """Read a PNG of the size of the benchmark and put it on white.

    Alpha is composited as in the original (roatienza/pc2pix@46795a46, loader.py): colour times
    alpha plus white times one minus alpha, rounded half up.

    Parameters
    ----------
    path : Path
        PNG of IMAGE_SIZE x IMAGE_SIZE pixels with 8 bits a channel.

    Returns
    -------
    image : uint8 array [IMAGE_SIZE, IMAGE_SIZE, 3]
        Colours on white.
    mode : str
        Mode of the file, such as "RGBA".

    Raises
    ------
    BadInput
        If the file is no PNG, is cut short, or has another size or more bits; names the file.
    """
    from PIL import Image

    with open_file(path, MOST_BYTES) as file, warnings.catch_warnings():
        warnings.simplefilter("error")  # of images that decompress to a huge size
        try:
            with Image.open(file, formats=("PNG",)) as image:
                size, mode = image.size, image.mode
                if size == (IMAGE_SIZE, IMAGE_SIZE) and mode in _MODES:
                    rgba = np.asarray(image.convert("RGBA"), np.float64)
                else:
                    rgba = None
        except Exception as error:  # Pillow lets through any error of its parsers
            raise BadInput(f"{path}: not a readable PNG ({error}); fetch it again") from error
    if rgba is None:
        raise BadInput(
            f"{path}: {size[0]} x {size[1]} pixels of mode {mode}, expected {IMAGE_SIZE} x "
            f"{IMAGE_SIZE} of 8 bits a channel; scale or convert it"
        )
    alpha = rgba[..., 3:] / 255.0
    return np.floor(rgba[..., :3] * alpha + 255.0 * (1.0 - alpha) + 0.5).astype(np.uint8), mode
