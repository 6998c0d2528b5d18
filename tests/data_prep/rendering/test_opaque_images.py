"""Images of methods from untrusted files: PNG without transparency."""

from __future__ import annotations

import io
import struct
import zlib

import numpy as np
import pytest
from PIL import Image

from data_prep.failures import BadInput
from data_prep.rendering.opaque_images import (
    check_opaque_png,
    read_opaque_png,
)

PIXELS = np.random.default_rng(0).integers(0, 256, (2, 128, 128, 3), np.uint8)


def png_of(image: Image.Image, **options) -> bytes:
    buffer = io.BytesIO()
    image.save(buffer, "PNG", **options)
    return buffer.getvalue()


def header_alone(width: int, height: int, bits: int, kind: int) -> bytes:
    """A PNG that claims a size, without an image of it."""
    body = b"IHDR" + struct.pack(">IIBBBBB", width, height, bits, kind, 0, 0, 0)
    chunk = struct.pack(">I", 13) + body + struct.pack(">I", zlib.crc32(body))
    return b"\x89PNG\r\n\x1a\n" + chunk


def problem(function, path, *arguments) -> str:
    with pytest.raises(BadInput) as error:
        function(path, *arguments)
    assert "\n" not in str(error.value)
    assert str(error.value).startswith(f"{path}: ")
    return str(error.value).removeprefix(f"{path}: ")


def test_rgb_and_grey_are_read_as_they_are(tmp_path):
    path = tmp_path / "a.png"
    path.write_bytes(png_of(Image.fromarray(PIXELS[0])))
    check_opaque_png(path)
    np.testing.assert_array_equal(read_opaque_png(path), PIXELS[0])
    path.write_bytes(png_of(Image.fromarray(PIXELS[0, ..., 0])))
    check_opaque_png(path)
    np.testing.assert_array_equal(read_opaque_png(path), PIXELS[0, ..., :1].repeat(3, axis=2))


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (b"", "not a PNG; write it again"),
        (b"GIF89a" + bytes(100), "not a PNG; write it again"),
        (header_alone(30000, 30000, 8, 2), "30000 x 30000 pixels, expected 128 x 128; draw it in"),
        (header_alone(128, 129, 8, 2), "128 x 129 pixels, expected 128 x 128; draw it in that"),
        (header_alone(128, 128, 16, 2), "16 bits a channel, grey or RGB; expected 8-bit RGB"),
        (png_of(Image.new("L", (128, 128)).convert("1")), "1 bits a channel, grey or RGB;"),
        (png_of(Image.new("RGBA", (128, 128))), "8 bits a channel, RGB with alpha; expected 8-bit"),
        (png_of(Image.new("LA", (128, 128))), "8 bits a channel, grey with alpha; expected 8-bit"),
        (header_alone(128, 128, 8, 3), "8 bits a channel, a palette; expected 8-bit RGB or grey"),
    ],
    ids=["empty", "gif", "bomb", "size", "16-bit", "1-bit", "rgba", "grey-alpha", "palette"],
)
def test_the_header_tells_what_cannot_be_used(tmp_path, data, expected):
    path = tmp_path / "a.png"
    path.write_bytes(data)
    assert problem(check_opaque_png, path).startswith(expected)
    assert problem(read_opaque_png, path).startswith(expected)


def test_damaged_and_transparent_images_are_refused_when_they_are_read(tmp_path):
    path = tmp_path / "a.png"
    whole = png_of(Image.fromarray(PIXELS[0]))
    path.write_bytes(whole[: len(whole) // 2])
    check_opaque_png(path)
    assert problem(read_opaque_png, path).startswith("not a readable PNG (")
    path.write_bytes(png_of(Image.new("RGB", (128, 128)), transparency=(0, 0, 0)))
    assert problem(read_opaque_png, path).startswith("has a transparent colour; ")
    path.write_bytes(whole + bytes(4 * 2**20))
    assert problem(check_opaque_png, path).endswith("give a smaller file")
