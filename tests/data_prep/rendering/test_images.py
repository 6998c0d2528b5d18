"""Images as numbers, and images in untrusted files: true ones, and those of methods."""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from data_prep.failures import BadInput
from data_prep.rendering.images import (
    blank,
    check_opaque_png,
    read_image,
    read_opaque_png,
    to_float,
    to_uint8,
)

LEVELS = np.arange(256, dtype=np.uint8)
PIXELS = np.random.default_rng(0).integers(0, 256, (128, 128, 3), np.uint8)


def test_all_levels_there_and_back() -> None:
    there = to_float(LEVELS)
    assert there.dtype == np.float32
    np.testing.assert_array_equal(there, (np.arange(256) / 255).astype(np.float32))  # the nearest
    np.testing.assert_array_equal(to_uint8(there), LEVELS, strict=True)


def test_halves_are_rounded_up_and_what_is_outside_clipped() -> None:
    values = np.random.default_rng(0).random(5000, dtype=np.float32)
    exact = [255 * Fraction(float(v)) + Fraction(1, 2) for v in values]
    # Two roundings of values below 256: an ulp is 2**-16 at most. Nearer to a tie either is right.
    clear = np.array([min(e % 1, 1 - e % 1) > Fraction(1, 2**15) for e in exact])
    assert clear.mean() > 0.99
    np.testing.assert_array_equal(to_uint8(values)[clear], np.array([int(e) for e in exact])[clear])
    half = np.arange(255, dtype=np.float32) + np.float32(0.5)
    values = half / np.float32(255)
    ties = values * np.float32(255) == half  # others are no ties in float32
    assert (ties & (np.arange(255) % 2 == 0)).sum() > 50  # half to even would send these down
    np.testing.assert_array_equal(to_uint8(values)[ties], LEVELS[1:][ties])
    values = np.array([-np.inf, -7, -1e-9, 1 + 1e-6, 2, np.inf], np.float32)
    assert to_uint8(values).tolist() == [0, 0, 0, 255, 255, 255]


def test_blank_is_white_and_each_callers_own() -> None:
    images = blank(3)
    np.testing.assert_array_equal(images, np.full((3, 128, 128, 3), 255, np.uint8), strict=True)
    images[0] = 0
    assert (blank(1) == 255).all()
    assert blank(0).shape == (0, 128, 128, 3)


def png_of(image: Image.Image, kind: str = "PNG", **options) -> bytes:
    buffer = io.BytesIO()
    image.save(buffer, kind, **options)
    return buffer.getvalue()


def header_alone(width: int, height: int, bits: int, kind: int) -> bytes:
    """A PNG that claims a size, without an image of it."""
    body = b"IHDR" + struct.pack(">IIBBBBB", width, height, bits, kind, 0, 0, 0)
    chunk = struct.pack(">I", 13) + body + struct.pack(">I", zlib.crc32(body))
    return b"\x89PNG\r\n\x1a\n" + chunk


RGB = png_of(Image.fromarray(PIXELS))


def test_images_of_methods_are_read_as_they_are(tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    for pixels in (PIXELS, PIXELS[..., 0]):
        path.write_bytes(png_of(Image.fromarray(pixels)))
        check_opaque_png(path)
        expected = np.broadcast_to(pixels.reshape(128, 128, -1), PIXELS.shape)
        np.testing.assert_array_equal(read_opaque_png(path), expected)


@pytest.mark.parametrize("mode", ["RGB", "RGBA", "L", "LA", "P"])
def test_true_images_of_all_modes(tmp_path: Path, mode: str) -> None:
    path = tmp_path / "a.png"
    Image.new("RGB", (128, 128), (102, 102, 102)).convert(mode).save(path)
    image, seen = read_image(path)
    assert (seen, np.unique(image).tolist()) == (mode, [102])  # which the palette of P has


def test_transparent_pixels_of_true_images_are_white(tmp_path: Path) -> None:
    rgba = np.zeros((128, 128, 4), np.uint8)
    rgba[0, :3] = (200, 100, 0, 255), (200, 103, 0, 128), (0, 0, 0, 1)
    Image.fromarray(rgba).save(tmp_path / "a.png")
    image, _ = read_image(tmp_path / "a.png")
    # 200 * 128/255 + 255 * 127/255 = 227.39, 103 -> 178.70, 0 -> 127; 0 at 1/255 -> 254.
    assert image[0, :4].tolist() == [[200, 100, 0], [227, 179, 127], [254] * 3, [255] * 3]


SIZE = "expected 128 x 128; draw it in that size"
OPAQUE = "expected 8-bit RGB or grey without alpha"
REFUSED = [  # a reader, the file, and what is said
    (read_image, png_of(Image.new("RGBA", (224, 224))), "224 x 224 pixels of mode RGBA"),
    (read_image, png_of(Image.new("I;16", (128, 128))), "128 x 128 pixels of mode I;16"),
    (read_image, png_of(Image.new("RGB", (128, 128)), "JPEG"), "not a readable PNG"),
    (read_image, b"\x89PNG\r\n\x1a\n" + b"x" * 99, "not a readable PNG"),
    (read_image, RGB[:9000], "not a readable PNG"),
    (read_image, None, "no such file"),
    (check_opaque_png, b"", "not a PNG; write it again"),
    (check_opaque_png, b"GIF89a" + bytes(100), "not a PNG; write it again"),
    (check_opaque_png, header_alone(30000, 30000, 8, 2), f"30000 x 30000 pixels, {SIZE}"),
    (check_opaque_png, header_alone(128, 129, 8, 2), f"128 x 129 pixels, {SIZE}"),
    (check_opaque_png, header_alone(128, 128, 16, 2), f"16 bits a channel, grey or RGB; {OPAQUE}"),
    (check_opaque_png, png_of(Image.new("1", (128, 128))), "1 bits a channel, grey or RGB;"),
    (
        check_opaque_png,
        png_of(Image.new("RGBA", (128, 128))),
        f"8 bits a channel, RGB with alpha; {OPAQUE}",
    ),
    (
        check_opaque_png,
        png_of(Image.new("LA", (128, 128))),
        f"8 bits a channel, grey with alpha; {OPAQUE}",
    ),
    (check_opaque_png, header_alone(128, 128, 8, 3), f"8 bits a channel, a palette; {OPAQUE}"),
    (check_opaque_png, RGB + bytes(4 * 2**20), "give a smaller file"),
    (read_opaque_png, RGB[: len(RGB) // 2], "not a readable PNG ("),
    (
        read_opaque_png,
        png_of(Image.new("RGB", (128, 128)), transparency=(0, 0, 0)),
        "has a transparent colour; write it as 8-bit RGB or grey",
    ),
]


@pytest.mark.parametrize(("read", "data", "says"), REFUSED, ids=[case[2] for case in REFUSED])
def test_files_that_cannot_be_used(tmp_path: Path, read: Callable, data: bytes, says: str) -> None:
    """Both readers of methods' images say what the header tells."""
    path = tmp_path / "a.png"
    if data is not None:
        path.write_bytes(data)
    for reader in (read, read_opaque_png) if read is check_opaque_png else (read,):
        with pytest.raises(BadInput) as error:
            reader(path)
        assert str(error.value).startswith(f"{path}: ")
        assert says in str(error.value)
        assert "\n" not in str(error.value)
    if read is read_opaque_png:
        check_opaque_png(path)
