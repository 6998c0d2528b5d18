"""Images as float32 in [0, 1] and as uint8, and images from untrusted files.

The header of a PNG, which tells its size, is checked before any pixels are decompressed.
"""

from __future__ import annotations

import struct
import warnings
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from data_prep.failures import BadInput
from data_prep.files.safe_read import MIB, open_file, reason_of
from data_prep.scene import IMAGE_SIZE, Images, UInt8Images

MOST_BYTES = 4 * MIB  # the largest PNG; 128 x 128 pixels RGBA have 64 KiB without compression
_MOST_BYTES_OF_ANY = 64 * MIB  # the largest file of an image of any size
_MODES = ("RGBA", "RGB", "LA", "L", "P")  # Pillow's names of the modes with 8 bits a channel
_SIGNATURE = b"\x89PNG\r\n\x1a\n\x00\x00\x00\x0dIHDR"
_HEADER = struct.Struct(">IIBB")  # width, height, bits a channel and colour type
_GREY, _RGB = 0, 2  # colour types of PNG that have no alpha
_KINDS = {3: "a palette", 4: "grey with alpha", 6: "RGB with alpha"}  # the other colour types


def to_uint8(images: Images) -> NDArray[np.uint8]:
    """Convert float32 images in [0, 1] to uint8, rounded half up as in the original's PNG writer.

    Values outside of [0, 1] are clipped; the caller has to check for NaN.
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


class _PngHeader(NamedTuple):
    """What the first bytes of a PNG say: its size, the bits a channel and its colour type."""

    width: int
    height: int
    bits: int
    kind: int


def _png_header(file: BinaryIO) -> _PngHeader | None:
    """Return the header of a file that is read from its start; None for no PNG."""
    start = file.read(len(_SIGNATURE) + _HEADER.size)
    if len(start) < len(_SIGNATURE) + _HEADER.size or not start.startswith(_SIGNATURE):
        return None
    return _PngHeader(*_HEADER.unpack(start[len(_SIGNATURE) :]))


class _Decoded(NamedTuple):
    """A PNG: its size and mode, whether it has a transparent colour, and RGBA [H, W, 4].

    Only pixels of the wanted size with 8 bits a channel are decoded. `frames` counts the images of
    an animation; the first one is decoded.
    """

    size: tuple[int, int]
    mode: str
    transparent: bool
    rgba: NDArray[np.uint8] | None
    frames: int


def _decoded(
    path: Path, remedy: str, formats: tuple[str, ...] = ("PNG",), most_bytes: int = MOST_BYTES
) -> _Decoded:
    from PIL import Image

    of_any_size = len(formats) > 1
    with open_file(path, most_bytes) as file, warnings.catch_warnings():
        warnings.simplefilter("error")  # Pillow warns of images that decompress to a huge size
        png = _png_header(file)
        file.seek(0)
        try:
            with Image.open(file, formats=formats) as image:
                # The further images of a JPEG are previews and depths of the same picture.
                moves = image.format in ("PNG", "WEBP")
                frames = getattr(image, "n_frames", 1) if moves else 1
                mode = image.mode
                if png is not None and png.bits > 8 and mode in _MODES:
                    mode += f" with {png.bits} bits a channel"  # Pillow cuts them off unasked
                fits = of_any_size or image.size == (IMAGE_SIZE, IMAGE_SIZE)
                usable = fits and mode in _MODES
                rgba = np.asarray(image.convert("RGBA"), np.uint8) if usable else None
                return _Decoded(image.size, mode, "transparency" in image.info, rgba, frames)
        except Exception as error:  # the parsers of Pillow may raise any exception
            kinds = " or ".join(formats)
            reason = reason_of(error)
            raise BadInput(f"{path}: not a readable {kinds} ({reason}); {remedy}") from error


def read_image(path: Path) -> tuple[UInt8Images, str]:
    """Return a PNG laid on white, uint8 [IMAGE_SIZE, IMAGE_SIZE, 3], and the mode of the file.

    Alpha is composited as in the original (roatienza/pc2pix@46795a46, loader.py): colour times
    alpha plus white times one minus alpha, rounded half up. Raises BadInput, which names the file,
    where it is no PNG, is cut short, or has another size or more bits a channel.
    """
    image = _decoded(path, "fetch it again")
    if image.rgba is None:
        raise BadInput(
            f"{path}: {image.size[0]} x {image.size[1]} pixels of mode {image.mode}, expected "
            f"{IMAGE_SIZE} x {IMAGE_SIZE} of 8 bits a channel; scale or convert it"
        )
    return _on_white(image.rgba), image.mode


def _on_white(rgba: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return an image [H, W, 4] laid on white, [H, W, 3]."""
    alpha = rgba[..., 3:] / 255.0
    white = np.floor(rgba[..., :3] * alpha + 255.0 * (1.0 - alpha) + 0.5)
    return white.astype(np.uint8)


def read_any_image(path: Path) -> tuple[NDArray[np.uint8], bool]:
    """Return a PNG, JPEG or WebP of any size laid on white, uint8 [H, W, 3].

    Also returned is whether a pixel was transparent. Raises BadInput for a file that cannot be
    read, for other than 8 bits a channel and for an animation.
    """
    image = _decoded(path, "write it again", ("PNG", "JPEG", "WEBP"), _MOST_BYTES_OF_ANY)
    if image.frames > 1:
        raise BadInput(f"{path}: an animation of {image.frames} images; write each to its own file")
    if image.rgba is None:
        raise BadInput(f"{path}: has pixels of mode {image.mode}; write it as 8-bit grey or RGB")
    return _on_white(image.rgba), bool((image.rgba[..., 3] < 255).any())


def check_opaque_png(path: Path) -> None:
    """Raise BadInput unless the header tells of a PNG of IMAGE_SIZE in 8-bit RGB or grey."""
    with open_file(path, MOST_BYTES) as file:
        png = _png_header(file)
    if png is None:
        raise BadInput(f"{path}: not a PNG; write it again")
    width, height, bits, kind = png
    if (width, height) != (IMAGE_SIZE, IMAGE_SIZE):
        raise BadInput(
            f"{path}: {width} x {height} pixels, expected {IMAGE_SIZE} x {IMAGE_SIZE}; draw it in "
            "that size"
        )
    if bits != 8 or kind not in (_GREY, _RGB):
        raise BadInput(
            f"{path}: {bits} bits a channel, {_KINDS.get(kind, 'grey or RGB')}; expected 8-bit RGB "
            "or grey without alpha; convert it"
        )


def read_opaque_png(path: Path) -> UInt8Images:
    """Return a method's image from a PNG, uint8 [IMAGE_SIZE, IMAGE_SIZE, 3].

    A grey image gets three equal channels. Raises BadInput as `check_opaque_png` does, and for a
    damaged file and one with a transparent colour.
    """
    check_opaque_png(path)
    image = _decoded(path, "write it again")
    # Checked again, as the file may have been exchanged for another one since its header was read.
    if image.rgba is None or image.mode not in ("RGB", "L") or image.transparent:
        raise BadInput(f"{path}: has a transparent colour; write it as 8-bit RGB or grey")
    return image.rgba[..., :3]
