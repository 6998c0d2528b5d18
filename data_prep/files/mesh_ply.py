"""Surfaces as PLY files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data_prep.files.atomic_write import write_whole


def save_surface(
    path: Path,
    corners: NDArray[np.float64],
    faces: NDArray[np.int32],
    colors: NDArray[np.uint8] | None = None,
    comments: Sequence[str] = (),
) -> None:
    """Write triangles as binary PLY, whole or not at all.

    path      file to write; missing folders are made
    corners   float64 [V, 3], kept as they are: coordinates of a map have more digits than float32
    faces     int32 [F, 3]: the corners of each triangle
    colors    uint8 [V, 3] of the corners, red, green and blue; None for none
    comments  lines for the header; what is not ASCII is written as an escape sequence

    Raises CannotWrite if the disk refuses.
    """
    properties = [(axis, "<f8") for axis in "xyz"]
    if colors is not None:
        properties += [(channel, "u1") for channel in ("red", "green", "blue")]
    vertices = np.empty(len(corners), properties)
    for i, axis in enumerate("xyz"):
        vertices[axis] = corners[:, i]
    for i, (channel, _) in enumerate(properties[3:]):
        assert colors is not None
        vertices[channel] = colors[:, i]
    polygons = np.empty(len(faces), [("corners", "u1"), ("faces", "<i4", 3)])
    polygons["corners"], polygons["faces"] = 3, faces
    names = {"<f8": "double", "u1": "uchar"}
    header = [
        "ply",
        "format binary_little_endian 1.0",
        *(f"comment {' '.join(comment.split())}" for comment in comments),
        f"element vertex {len(vertices)}",
        *(f"property {names[kind]} {name}" for name, kind in properties),
        f"element face {len(polygons)}",
        "property list uchar int vertex_indices",
        "end_header\n",
    ]
    text = "\n".join(header).encode("ascii", "backslashreplace")
    data = text + vertices.tobytes() + polygons.tobytes()
    write_whole(path, data, remedy="make room, or give another path")
