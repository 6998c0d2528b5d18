"""Objects in the paper's own layout: the counterpart of `dataset_paper`.

What is written is read back bit for bit: coordinates are permuted, halved and given signs, which
rounds nothing, and angles have all their digits.
"""

from __future__ import annotations

import io
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_prep.cloud_files import save_ply
from data_prep.dataset_paper import CLOUDS, RADIUS, RENDERS, SPLIT_SUFFIX, VIEWS, picture_name
from data_prep.failures import BadInput, CannotWrite
from data_prep.orientations import PAPER
from data_prep.scene import PointCloud, View
from data_prep.synsets import SYNSETS
from data_prep.untrusted import plain_name
from data_prep.whole_files import write_whole


def folder_name(class_name: str) -> str:
    """The synset of a class, or its own name where it is none of the 13."""
    return SYNSETS.get(class_name, class_name)


def check_names(class_name: str, object_id: str) -> None:
    """Raises BadInput where class or object cannot be the name of a file."""
    try:
        plain_name(class_name)
        plain_name(object_id)
    except ValueError as error:
        raise BadInput(
            f"{class_name}/{object_id}: {error}; put its file directly into the folder of its class"
        ) from None


def write_object(
    root: Path,
    class_name: str,
    object_id: str,
    cloud: PointCloud,
    views: Sequence[View],
    pictures: NDArray[np.uint8],
) -> None:
    """The cloud, the cameras and the pictures [V, H, W, 3] of an object.

    Pictures become RGBA, as the original's, without a transparent pixel. Raises CannotWrite.
    """
    from PIL import Image

    synset = folder_name(class_name)
    points = PAPER.from_ours(cloud.points) * np.float32(RADIUS)
    save_ply(points, root / CLOUDS / synset / f"{object_id}.ply")
    renders = root / RENDERS / synset / object_id
    lines = [f"{-view.azimuth_deg!r} {view.elevation_deg!r}\n" for view in views]
    _write(renders / VIEWS, "".join(lines).encode())
    for k, picture in enumerate(pictures):
        buffer = io.BytesIO()
        Image.fromarray(picture).convert("RGBA").save(buffer, "PNG")
        _write(renders / picture_name(k), buffer.getvalue())


def write_split(root: Path, name: str, classes: Mapping[str, Sequence[str]]) -> Path:
    """`NAME_exp.json`, by class the ids of the test objects; there are no others to train on.

    Returns its path. Raises CannotWrite.
    """
    tree: dict[str, Any] = {
        folder_name(class_name): {"name": class_name, "train": [], "test": list(ids)}
        for class_name, ids in classes.items()
    }
    path = root / f"{name}{SPLIT_SUFFIX}"
    _write(path, (json.dumps(tree, indent=1, ensure_ascii=False) + "\n").encode())
    return path


def _write(path: Path, data: bytes) -> None:
    try:
        write_whole(path, data, synced=False)
    except OSError as error:
        raise CannotWrite(
            f"{path}: cannot be written ({error.strerror}); make room, or give another --out"
        ) from error
