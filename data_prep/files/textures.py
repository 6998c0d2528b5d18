"""Textures of meshes: pictures read within limits, and the colours of faces in them."""

from __future__ import annotations

import io
import warnings
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from data_prep.failures import BadInput
from data_prep.files.mesh_contents import FaceColors
from data_prep.files.safe_read import shown

# The most pixels of a texture (8,192 x 8,192). Its file may be small, but takes 1.4 GiB of memory
# while it is decoded.
MOST_PIXELS = 2**26
# The formats that are decoded. PostScript is not among them, as Pillow would run it with
# Ghostscript.
_FORMATS = ("PNG", "JPEG", "WEBP", "BMP", "TGA", "TIFF", "GIF", "PPM", "DDS")


class TooLarge(BadInput):
    """A texture of too many pixels."""


def _pixels_of(data: bytes) -> NDArray[np.uint8] | None:
    """Return the pixels uint8 [H, W, 3] of a picture; None for bytes that are no picture.

    Raises TooLarge for a picture of more than MOST_PIXELS.
    """
    from PIL import Image

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of large pictures, which are refused below
            with Image.open(io.BytesIO(data), formats=_FORMATS) as image:
                if image.width * image.height > MOST_PIXELS:
                    raise TooLarge(
                        f"a texture of {image.width} x {image.height} pixels, at most "
                        f"{MOST_PIXELS} are read; give a smaller one"
                    )
                if image.mode.startswith("I"):  # grey of 16 bits, which Pillow would cut at 255
                    grey = (np.asarray(image) // 257).clip(0, 255).astype(np.uint8)
                    return np.repeat(grey[..., None], 3, axis=2)
                return np.asarray(image.convert("RGB"))
    except TooLarge:
        raise
    except Image.DecompressionBombError:
        raise TooLarge(f"a texture of more than {MOST_PIXELS} pixels; give a smaller one") from None
    except Exception:  # the decoders of Pillow may raise any exception
        return None


class TextureReader:
    """The textures of a mesh, each read once.

    notes  lines on those that are not there or cannot be read
    """

    def __init__(self, read: Callable[[str], bytes | None]) -> None:
        """Keep the function that returns the bytes behind a name, None where there are none."""
        self._read = read
        self._pixels: dict[str, NDArray[np.uint8] | None] = {}
        self._count = 0
        self.notes: list[str] = []

    def pixels(self, name: str) -> NDArray[np.uint8] | None:
        """Return the pixels uint8 [H, W, 3] of a texture; None where it cannot be had.

        Raises TooLarge for pictures of more than MOST_PIXELS together.
        """
        if name not in self._pixels:
            data = self._read(name)
            pixels = None if data is None else _pixels_of(data)
            self._pixels[name] = pixels
            self._count += 0 if pixels is None else pixels.shape[0] * pixels.shape[1]
            if self._count > MOST_PIXELS:
                raise TooLarge(
                    f"textures of {self._count} pixels together, at most {MOST_PIXELS} are read; "
                    "give smaller ones"
                )
            if data is None:
                self.notes.append(f"the texture {shown(name)} is not there")
            elif self._pixels[name] is None:
                self.notes.append(f"the texture {shown(name)} is no picture that can be read")
        return self._pixels[name]


@np.errstate(invalid="ignore")  # places may be NaN
def colors_at(pixels: NDArray[np.uint8], places: NDArray[np.float64]) -> FaceColors:
    """Return the colours uint8 [N, 3] of the pixels at places of a texture.

    pixels  uint8 [H, W, 3], the first row on top
    places  float64 [N, 2] from the upper left corner, 0 to 1 to the right and down; beyond that the
            texture repeats itself, and a place that is not finite counts as the corner
    """
    height, width = pixels.shape[:2]
    places = np.where(np.isfinite(places), places, 0.0)
    places = places - np.floor(places)
    columns = np.minimum((places[:, 0] * width).astype(np.int64), width - 1)
    rows = np.minimum((places[:, 1] * height).astype(np.int64), height - 1)
    return pixels[rows, columns]


def from_below(places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return places [N, 2] as `colors_at` takes them.

    places  float64 [N, 2], counted to the right and upwards from the lower left corner
    """
    return np.stack([places[:, 0], 1.0 - places[:, 1]], axis=1)
