"""Several clouds in one call: the files to draw and the names of their images."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from bench.rendering.files import MOVING, STILL, moves
from data_prep.datasets.dataset import listed
from data_prep.failures import BadInput
from data_prep.files.clouds import CLOUD_SUFFIXES, check_cloud_name, clouds_below


def image_of_cloud(cloud: Path, out: Path | None) -> Path:
    """Return the image of a cloud alone: `out`, or beside it, with its name and .png.

    Raises BadInput for a file that cannot be one, and for an existing image that `out` does not
    name.
    """
    # The cloud's name is checked before it becomes that of the image.
    _check_file(cloud)
    image = out or cloud.with_suffix(STILL)
    if out is None and image.exists():
        raise BadInput(f"{image}: exists already; -o {image} replaces it, -o NAME keeps both")
    moves(image)  # raises BadInput for the name of another kind of file
    if image.is_dir():
        raise BadInput(f"{image}: a folder; give another -o")
    if not image.parent.is_dir():
        raise BadInput(f"{image}: no such folder, {image.parent}; make it, or give another -o")
    return image


def images_of_clouds(
    paths: Sequence[Path], folder: Path
) -> tuple[Mapping[Path, Path], tuple[str, ...]]:
    """Return the image of each cloud, `folder` / its name and .png, and notes on other files.

    Parameters
    ----------
    paths : sequence of Path
        Files, and folders: all clouds below one are taken, and keep their sub-folders.
    folder : Path
        The folder of the images, which need not exist.

    Raises
    ------
    BadInput
        For a path without clouds, for clouds that would have the same image, and where `folder`
        cannot be the folder.
    """
    _check_folder(folder)
    images: dict[Path, Path] = {}
    clouds: dict[Path, Path] = {}
    notes = []
    for path in paths:
        root = path if path.is_dir() else path.parent
        if path.is_dir():
            named, others = clouds_below(path)
            if not named:
                kinds = ", ".join(CLOUD_SUFFIXES)
                has = f" (it has {listed(others)})" if others else ""
                raise BadInput(f"{path}: no clouds in this folder{has}; give one with {kinds}")
            if others:
                notes.append(
                    f"{path}: left out, no clouds by their names or contents: {listed(others)}"
                )
        else:
            _check_file(path)
            named = (path,)
        for cloud in named:
            if cloud in images:  # named twice
                continue
            image = images[cloud] = folder / cloud.relative_to(root).with_suffix(STILL)
            if clouds.setdefault(image, cloud) != cloud:
                raise BadInput(
                    f"{clouds[image]} and {cloud} would both be drawn as {image}; rename one, or "
                    "draw them into two folders"
                )
    return images, tuple(notes)


def _check_file(cloud: Path) -> None:
    check_cloud_name(cloud)
    if not cloud.exists():
        raise BadInput(f"{cloud}: no such file; check its name")


def _check_folder(folder: Path) -> None:
    if folder.suffix.lower() in (STILL, *MOVING) and not folder.is_dir():
        raise BadInput(f"{folder}: one name for several clouds; give the folder of their images")
    if folder.exists() and not folder.is_dir():
        raise BadInput(f"{folder}: a file; give the folder of the images")
    if not folder.absolute().parent.is_dir():
        raise BadInput(f"{folder}: no such folder, {folder.parent}; make it, or give another -o")
