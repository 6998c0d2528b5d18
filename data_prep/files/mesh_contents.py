"""The contents of a mesh file, as all of its readers return them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data_prep.scene import NEUTRAL_GREY

FaceColors = NDArray[np.uint8]  # [F, 3]


@dataclass(frozen=True, eq=False)
class MeshContents:
    """The triangles of a file with the axes and the size that it has there.

    vertices     float64 array [V, 3]
    faces        int64 array [F, 3]: the vertices of each triangle
    face_colors  uint8 array [F, 3]: red, green and blue; neutral grey where the file has none
    notes        lines for the user on what the file names but could not be found or read, such as
                 "the texture 'wood.png' is not there"
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    face_colors: FaceColors
    notes: tuple[str, ...] = ()


class NotAMesh(Exception):
    """Raised for a file that holds no mesh, with the problem and its remedy.

    `read_mesh` adds the name of the file.
    """


def grey_faces(count: int) -> FaceColors:
    """Return the colours [F, 3] of faces that have none in their file."""
    return np.tile(np.array(NEUTRAL_GREY, np.uint8), (count, 1))


def corner_means(colors: NDArray[np.uint8], faces: NDArray[np.int64]) -> FaceColors:
    """Return for each face the mean of the colours of its three vertices, rounded down."""
    return (colors[faces].astype(np.uint16).sum(axis=1) // 3).astype(np.uint8)
