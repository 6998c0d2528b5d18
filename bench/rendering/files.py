"""Images as PNG, and turntables as GIF, WebP or APNG, by the name of the file."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from data_prep.failures import BadInput, CannotWrite
from data_prep.files.atomic_write import write_whole

if TYPE_CHECKING:
    from PIL.Image import Image

STILL = ".png"
MOVING = (".gif", ".webp", ".apng")
TURN_MS = 3600
LEAST_MS = 40  # 25 frames a second
GIF_MS = 10  # a GIF counts in hundredths of a second
KMEANS_STEPS = 4  # turntable of one chair: 4.8 grey levels off (rms) in place of 5.4


def moves(path: Path) -> bool:
    """Whether a turntable goes by that name, and not an image. Raises BadInput if neither does."""
    suffix = path.suffix.lower()
    if suffix != STILL and suffix not in MOVING:
        raise BadInput(
            f"{path}: pictures are written as PNG, turntables as GIF, WebP or APNG; give a name "
            f"that ends in {STILL}, {', '.join(MOVING[:-1])} or {MOVING[-1]}"
        )
    return suffix in MOVING


def frame_ms(frames: int) -> int:
    """How long a frame stays, so that a turn takes about TURN_MS; not less than LEAST_MS."""
    return max(LEAST_MS, round(TURN_MS / frames / GIF_MS) * GIF_MS)


def write_images(frames: NDArray[np.uint8], path: Path) -> None:
    """Write frames [F, H, W, 3] whole or not at all: the only one as PNG, else a film that loops.

    PNG, APNG and WebP hold the images as they are, a GIF in 256 colours. Raises CannotWrite.
    """
    from PIL import Image

    images = [Image.fromarray(frame) for frame in frames]
    film: dict[str, Any] = {}
    if moves(path):
        film = {"save_all": True, "duration": frame_ms(len(frames)), "loop": 0}
    match path.suffix.lower():
        case ".gif":
            images, form = in_one_palette(frames), "GIF"
        case ".webp":
            form, film["lossless"] = "WEBP", True
        case _:
            form = "PNG"
    if film:
        film["append_images"] = images[1:]
    buffer = io.BytesIO()
    images[0].save(buffer, form, **film)
    try:
        write_whole(path, buffer.getvalue())
    except OSError as error:
        raise CannotWrite(
            f"{path}: cannot be written ({error.strerror}); make room, or give another -o"
        ) from error


def in_one_palette(frames: NDArray[np.uint8]) -> list[Image]:
    """The frames in the same 256 colours, white among them, each pixel in the nearest.

    With a palette for each frame, or with dots that stand for a colour, the film would flicker.
    Colours count by the root of how often they are there: in full, large even areas would take the
    palette; not at all, and shades of grey would be lost beside many colours.
    """
    from PIL import Image
    from scipy.spatial import cKDTree

    packed = frames.astype(np.uint32) @ np.array([1 << 16, 1 << 8, 1], np.uint32)
    values, which, counts = np.unique(packed, return_inverse=True, return_counts=True)
    colours = ((values[:, None] >> np.array([16, 8, 0], np.uint32)) & 255).astype(np.uint8)
    drawn = (colours < 255).any(axis=1)
    palette = np.full((256, 3), 255, np.uint8)
    if drawn.any():
        weights = np.sqrt(counts[drawn]).astype(np.int64)
        pool = Image.fromarray(np.repeat(colours[drawn], weights, axis=0)[:, None])
        chosen = pool.quantize(255, Image.Quantize.MEDIANCUT, kmeans=KMEANS_STEPS).getpalette()
        found = np.array(chosen, np.uint8).reshape(-1, 3)[:255]
        palette[: len(found)] = found
    _, nearest = cKDTree(palette.astype(float)).query(colours.astype(float))
    indexed = np.ravel(nearest).astype(np.uint8)[which].reshape(frames.shape[:3])
    images = [Image.fromarray(frame) for frame in indexed]
    for image in images:
        image.putpalette(palette.tobytes())
    return images
