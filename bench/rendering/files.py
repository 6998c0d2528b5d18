"""Files of images: PNG, and turntables as GIF, WebP or APNG, by the suffix of the name."""

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
_TURN_MS = 3600
_LEAST_MS = 40  # 25 frames a second
_GIF_MS = 10  # a GIF counts in hundredths of a second
_KMEANS_STEPS = 4  # turntable of one chair: 4.8 grey levels off (rms) in place of 5.4


def moves(path: Path) -> bool:
    """Return whether a name is a turntable's, else an image's. Raises BadInput for any other."""
    suffix = path.suffix.lower()
    if suffix != STILL and suffix not in MOVING:
        raise BadInput(
            f"{path}: images are written as PNG, turntables as GIF, WebP or APNG; give a name "
            f"that ends in {STILL}, {', '.join(MOVING[:-1])} or {MOVING[-1]}"
        )
    return suffix in MOVING


def check_opacity(path: Path) -> None:
    """Raise BadInput for the name of a file whose format has no opacity of its pixels."""
    if path.suffix.lower() not in (STILL, *MOVING) or path.suffix.lower() == ".gif":
        raise BadInput(
            f"{path}: a {path.suffix[1:].upper()} has no opacity of its pixels; give a name that "
            "ends in .png, .apng or .webp"
        )


def _frame_ms(frames: int) -> int:
    """Return the milliseconds of a frame, at least _LEAST_MS: a turn takes about _TURN_MS."""
    return max(_LEAST_MS, round(_TURN_MS / frames / _GIF_MS) * _GIF_MS)


def write_images(frames: NDArray[np.uint8], path: Path) -> None:
    """Write an image, or a turntable that loops, whole or not at all.

    PNG, APNG and WebP keep the pixels, a GIF has 256 colours.

    Parameters
    ----------
    frames : ndarray
        uint8 [F, H, W, 3], or [F, H, W, 4] with an opacity, which a GIF cannot have; a PNG takes
        the first one.
    path : Path
        .png for an image, .gif, .webp or .apng for a turntable.

    Raises
    ------
    data_prep.failures.BadInput
        For another suffix, and for an opacity in a GIF.
    data_prep.failures.CannotWrite
        Where the file cannot be written.
    """
    from PIL import Image

    if frames.shape[-1] == 4:
        check_opacity(path)
    images = [Image.fromarray(frame) for frame in frames]
    film: dict[str, Any] = {}
    if moves(path):
        film = {"save_all": True, "duration": _frame_ms(len(frames)), "loop": 0}
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
    """Return frames uint8 [F, H, W, 3] in the same 256 colours, each pixel in the nearest one.

    White is one of them.
    """
    # With a palette for each frame, or with dithering, the film would flicker.
    from PIL import Image
    from scipy.spatial import cKDTree

    packed = frames.astype(np.uint32) @ np.array([1 << 16, 1 << 8, 1], np.uint32)
    values, which, counts = np.unique(packed, return_inverse=True, return_counts=True)
    colours = ((values[:, None] >> np.array([16, 8, 0], np.uint32)) & 255).astype(np.uint8)
    drawn = (colours < 255).any(axis=1)
    palette = np.full((256, 3), 255, np.uint8)
    if drawn.any():
        # Colours count by the root of their pixels: in full, large even areas would take the
        # palette; not at all, shades of grey would be lost beside many colours.
        weights = np.sqrt(counts[drawn]).astype(np.int64)
        pool = Image.fromarray(np.repeat(colours[drawn], weights, axis=0)[:, None])
        chosen = pool.quantize(255, Image.Quantize.MEDIANCUT, kmeans=_KMEANS_STEPS).getpalette()
        colours_chosen = np.array(chosen, np.uint8).reshape(-1, 3)[:255]
        palette[: len(colours_chosen)] = colours_chosen
    _, nearest = cKDTree(palette.astype(float)).query(colours.astype(float))
    indexed = np.ravel(nearest).astype(np.uint8)[which].reshape(frames.shape[:3])
    images = [Image.fromarray(frame) for frame in indexed]
    for image in images:
        image.putpalette(palette.tobytes())
    return images
