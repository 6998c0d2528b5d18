"""Images of methods in untrusted files: PNG without transparency.

Nothing is unpacked before the header has said how much there is.
"""

from __future__ import annotations

import struct
import warnings
from pathlib import Path

import numpy as np

from data_prep.failures import BadInput
from data_prep.files.safe_read import open_file, reason_of
from data_prep.rendering.images import MOST_BYTES
from data_prep.scene import IMAGE_SIZE, UInt8Images

_SIGNATURE = b"\x89PNG\r\n\x1a\n\x00\x00\x00\x0dIHDR"
_HEADER = struct.Struct(">IIBB")  # width, height, bits and type of colour
_GREY, _RGB = 0, 2  # types of colour
_KINDS = {3: "a palette", 4: "grey with alpha", 6: "RGB with alpha"}


def check_opaque_png(path: Path) -> None:
    """Raise BadInput unless the header is of a PNG of the benchmark's size, 8-bit RGB or grey."""
    with open_file(path, MOST_BYTES) as file:
        start = file.read(len(_SIGNATURE) + _HEADER.size)
    if len(start) < len(_SIGNATURE) + _HEADER.size or not start.startswith(_SIGNATURE):
        raise BadInput(f"{path}: not a PNG; write it again")
    width, height, bits, kind = _HEADER.unpack(start[len(_SIGNATURE) :])
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
    """Return the image in a PNG, [IMAGE_SIZE, IMAGE_SIZE, 3]; grey has three equal channels.

    Raises BadInput as `check_opaque_png`, and for damaged files and transparent colours.
    """
    from PIL import Image

    check_opaque_png(path)
    with open_file(path, MOST_BYTES) as file, warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            with Image.open(file, formats=("PNG",)) as image:
                # The file may be another one by now.
                size, transparent = image.size, "transparency" in image.info
                pixels = None
                if size == (IMAGE_SIZE, IMAGE_SIZE) and image.mode in ("RGB", "L"):
                    pixels = np.asarray(image.convert("RGB"), np.uint8)
        except Exception as error:  # Pillow lets through any error of its parsers
            reason = reason_of(error)
            raise BadInput(f"{path}: not a readable PNG ({reason}); write it again") from error
    if pixels is None or transparent:
        raise BadInput(f"{path}: has a transparent colour; write it as 8-bit RGB or grey")
    return pixels
