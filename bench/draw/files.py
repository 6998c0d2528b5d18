"""Files of images: their names, and how they are written in the format of their suffix."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from bench.draw.mesh_file import MESH_SUFFIXES
from data_prep.datasets.dataset import first_names
from data_prep.failures import BadInput
from data_prep.files.atomic_write import write_whole
from data_prep.files.clouds import CLOUD_SUFFIXES, clouds_below
from data_prep.scene import View

if TYPE_CHECKING:
    from PIL.Image import Image

DRAWN = (*CLOUD_SUFFIXES, *MESH_SUFFIXES)  # the suffixes of files that can be drawn
_STILL = (".png", ".jpg", ".jpeg")  # the suffixes of single images
MOVING = (".gif", ".webp")
_FORMS = {".gif": "GIF", ".webp": "WEBP", ".jpg": "JPEG", ".jpeg": "JPEG"}  # others are PNG
_TURN_MS = 3600  # milliseconds that a whole turn takes, about: slow enough to look at
_LEAST_MS = 40  # the shortest time of a frame in milliseconds: 25 frames a second
_GIF_MS = 10  # the unit of time in a GIF in milliseconds: times of frames are multiples of it


def image_of_cloud(cloud: Path, out: Path | None, form: str = "png") -> Path:
    """Return the file of the image of one cloud: `out`, or one beside the cloud with its name.

    form  the suffix of a file beside the cloud, without its dot

    Raises BadInput for a cloud that does not exist or whose name is not that of a cloud, and for an
    `out` that cannot be the file of an image.
    """
    # The name of the cloud is checked first: a wrong one would make a wrong name for the image.
    _check_file(cloud)
    image = out or cloud.with_suffix(f".{form}")
    moves(image)  # raises BadInput for the name of another kind of file
    if image.is_dir():
        raise BadInput(f"{image}: is a folder; give the name of a file with -o")
    _check_parent(image)
    return image


def names_of_views(views: Sequence[View]) -> tuple[str, ...]:
    """Return a name for each view, of its angles."""
    return tuple(f"az{view.azimuth_deg:.15g}-el{view.elevation_deg:.15g}" for view in views)


def files_of_views(image: Path, names: Sequence[str]) -> tuple[Path, ...]:
    """Return a file for each view, named after the image and the view.

    For a single view that is the image itself. A turntable has one view, from which it starts.
    """
    if len(names) == 1:
        return (image,)
    return tuple(image.with_name(f"{image.stem}-{name}{image.suffix}") for name in names)


def images_of_clouds(
    paths: Sequence[Path], folder: Path, form: str = "png"
) -> tuple[Mapping[Path, Path], tuple[str, ...]]:
    """Return the image file of each cloud, and notes on files that are left out.

    paths   files of clouds and meshes, or folders; of a folder all of these below it are drawn, and
            their images stand in the same sub-folders
    folder  the folder of the images, which need not exist
    form    the suffix of the images, without its dot

    Raises BadInput for a path without clouds, for clouds that would have the same image, and for a
    `folder` that is a file.
    """
    if folder.suffix.lower() in (*_STILL, *MOVING) and not folder.is_dir():
        raise BadInput(
            f"{folder}: is the name of one image, for several clouds; give a folder for the images"
        )
    if folder.exists() and not folder.is_dir():
        raise BadInput(f"{folder}: is a file; give a folder for the images")
    _check_parent(folder)
    images: dict[Path, Path] = {}
    clouds: dict[Path, Path] = {}
    notes = []
    for path in paths:
        root = path if path.is_dir() else path.parent
        if path.is_dir():
            named, others = clouds_below(path, DRAWN)
            if not named:
                kinds = ", ".join(DRAWN)
                has = f" (it has {first_names(others)})" if others else ""
                raise BadInput(
                    f"{path}: no clouds or meshes in this folder{has}; give one with files {kinds}"
                )
            if others:
                why = "left out, no clouds or meshes by their names or contents"
                notes.append(f"{path}: {why}: {first_names(others)}")
        else:
            _check_file(path)
            named = (path,)
        for cloud in named:
            if cloud in images:  # two of the paths lead to this cloud
                continue
            image = images[cloud] = folder / cloud.relative_to(root).with_suffix(f".{form}")
            if clouds.setdefault(image, cloud) != cloud:
                raise BadInput(
                    f"{clouds[image]} and {cloud} would both be drawn as {image}; rename one, or "
                    "draw them into two folders"
                )
    return images, tuple(notes)


def _check_file(cloud: Path) -> None:
    if cloud.suffix.lower() not in DRAWN:
        name = cloud.suffix or "a name without a suffix"
        raise BadInput(
            f"{cloud}: {name} is not supported as a cloud or mesh; use one of {', '.join(DRAWN)}"
        )
    if not cloud.exists():
        raise BadInput(f"{cloud}: no such file; check its name")


def _check_parent(path: Path) -> None:
    if not path.absolute().parent.is_dir():
        raise BadInput(f"{path}: no such folder, {path.parent}; make it, or give another -o")


def moves(path: Path) -> bool:
    """Return whether a file of this name is a turntable; False for a single image.

    Raises BadInput for a name whose suffix is of neither.
    """
    suffix = path.suffix.lower()
    if suffix not in (*_STILL, *MOVING):
        raise BadInput(
            f"{path}: images are written as PNG or JPEG, turntables as GIF or WebP; give a name "
            f"that ends in {', '.join(_STILL[:2])}, {', '.join(MOVING[:-1])} or {MOVING[-1]}"
        )
    return suffix in MOVING


def check_opacity(path: Path) -> None:
    """Raise BadInput for a GIF and a JPEG, which cannot keep the opacity of pixels."""
    if (form := _FORMS.get(path.suffix.lower())) in ("GIF", "JPEG"):
        raise BadInput(
            f"{path}: a {form} cannot have transparent pixels; give a name that "
            "ends in .png or .webp"
        )


def write_images(frames: NDArray[np.uint8], path: Path) -> None:
    """Write an image, or a turntable that loops, whole or not at all.

    PNG and WebP keep the pixels, a GIF has 256 colours, a JPEG is compressed (quality 95).

    Parameters
    ----------
    frames : ndarray
        uint8 [F, H, W, 3] or an image [H, W, 3], or 4 with an opacity, which a GIF and a JPEG
        cannot have; a PNG and a JPEG take the first one.
    path : Path
        .png or .jpg for an image, .gif or .webp for a turntable.

    Raises
    ------
    data_prep.failures.BadInput
        For another suffix, and for an opacity in a GIF or a JPEG.
    data_prep.failures.CannotWrite
        Where the file cannot be written.
    """
    from PIL import Image

    frames = frames[None] if frames.ndim == 3 else frames
    turns, form = moves(path), _FORMS.get(path.suffix.lower(), "PNG")
    if frames.shape[-1] == 4:
        check_opacity(path)
    images = in_one_palette(frames) if form == "GIF" else list(map(Image.fromarray, frames))
    best = {"WEBP": {"lossless": True}, "JPEG": {"quality": 95, "subsampling": 0}}
    film: dict[str, Any] = best.get(form, {})
    if turns:
        frame_ms = max(_LEAST_MS, round(_TURN_MS / len(frames) / _GIF_MS) * _GIF_MS)
        film |= {"save_all": True, "duration": frame_ms, "loop": 0, "append_images": images[1:]}
    buffer = io.BytesIO()
    images[0].save(buffer, form, **film)
    write_whole(path, buffer.getvalue(), remedy="make room, or give another -o")


def in_one_palette(frames: NDArray[np.uint8]) -> list[Image]:
    """Return frames uint8 [F, H, W, 3] in the same 256 colours at most, chosen by Pillow.

    Each pixel gets the nearest of these colours.
    """
    from PIL import Image

    # With a palette for each frame, or with dithering, still pixels would flicker. So the colours
    # are chosen for all frames together, one below the other.
    together = Image.fromarray(frames.reshape(-1, *frames.shape[2:]))
    chosen = together.quantize(256, dither=Image.Dither.NONE)
    whole = [Image.fromarray(frame) for frame in frames]
    return [image.quantize(palette=chosen, dither=Image.Dither.NONE) for image in whole]
