"""Images of methods in untrusted files: PNG without transparency, and arrays in NPZ.

Nothing is unpacked before the header has said how much there is.
"""

from __future__ import annotations

import io
import struct
import warnings
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from data_prep.failures import BadInput
from data_prep.files.safe_read import open_file, reason_of
from data_prep.rendering.images import MOST_BYTES
from data_prep.scene import IMAGE_SIZE, UInt8Images

MEMBER = "images.npy"  # of an NPZ
_SIGNATURE = b"\x89PNG\r\n\x1a\n\x00\x00\x00\x0dIHDR"
_HEADER = struct.Struct(">IIBB")  # width, height, bits and type of colour
_GREY, _RGB = 0, 2  # types of colour
_KINDS = {3: "a palette", 4: "grey with alpha", 6: "RGB with alpha"}
_NPY_HEADER = 10_000  # bytes, at most; NumPy refuses longer ones
_ZIP_EXTRA = 10_000  # bytes of an NPZ beside its array


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


def check_image_array(path: Path, count: int) -> None:
    """Raise BadInput unless an NPZ has one array `images`, uint8 [count, 128, 128, 3].

    Of the array the header alone is read.
    """
    _read_array(path, count, whole=False)


def read_image_array(path: Path, count: int) -> UInt8Images:
    """Return the `count` images of an NPZ. Raises BadInput as `check_image_array`, and if damaged.

    A damaged array may be cut short or fail its CRC.
    """
    return _read_array(path, count, whole=True)


def _read_array(path: Path, count: int, whole: bool) -> Any:
    shape = (count, IMAGE_SIZE, IMAGE_SIZE, 3)
    size = int(np.prod(shape))
    with open_file(path, size + size // 100 + _ZIP_EXTRA) as file:
        try:
            with zipfile.ZipFile(file) as archive:
                member = _only_member(path, archive)
                if member.file_size > size + _NPY_HEADER:
                    raise BadInput(
                        f"{path}: {MEMBER} unpacks to {member.file_size} bytes, and {count} images "
                        f"have {size}; write uint8 {list(shape)}"
                    )
                with archive.open(member) as stream:
                    stored, fortran, dtype = _npy_header(stream)
                    if dtype != np.uint8 or stored != shape or fortran:
                        order = ", Fortran order" * fortran
                        raise BadInput(
                            f"{path}: images are {dtype} {list(stored)}{order}, expected uint8 "
                            f"{list(shape)} in C order, one a view of the export; write them so"
                        )
                    data = stream.read(size + 1) if whole else b""
        except BadInput:
            raise
        except Exception as error:  # zipfile and NumPy let through any error of their parsers
            reason = reason_of(error)
            raise BadInput(f"{path}: not a readable NPZ ({reason}); write it again") from error
    if not whole:
        return None
    if len(data) != size:
        raise BadInput(f"{path}: {len(data)} bytes of images, expected {size}; write it again")
    return np.frombuffer(data, np.uint8).reshape(shape)


def _only_member(path: Path, archive: zipfile.ZipFile) -> zipfile.ZipInfo:
    members = archive.infolist()
    if [member.filename for member in members] != [MEMBER]:
        raise BadInput(
            f"{path}: {len(members)} arrays, expected one with the name 'images'; write it with "
            "numpy.savez_compressed(path, images=images)"
        )
    # Other methods unpack without a bound on what one read takes.
    if members[0].compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise BadInput(
            f"{path}: packed by the method {members[0].compress_type} of ZIP; write it with "
            "numpy.savez_compressed"
        )
    return members[0]


def _npy_header(stream: Any) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Return shape, Fortran order and type of an array, of which nothing else is read."""
    start = stream.read(10)
    (length,) = struct.unpack("<H", start[8:10]) if start[6:7] == b"\x01" else (None,)
    if not start.startswith(b"\x93NUMPY") or length is None:
        raise ValueError("no array of NPY version 1")
    header = io.BytesIO(start[8:] + stream.read(length))
    return np.lib.format.read_array_header_1_0(header)
