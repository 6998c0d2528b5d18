"""How other datasets place their objects, and the way from there to +Y up, front towards -Z.

All are rotations by quarter turns: a permutation of the axes with signs. They round nothing, so an
object that is written in two layouts comes out bit for bit the same.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Orientation:
    """Our x, y and z are the axes `columns` (0..2) of the file, times `signs`.

    up, front  the file's axes, in words
    source     where that is stated, or how it was found
    """

    up: str
    front: str
    columns: tuple[int, int, int]
    signs: tuple[int, int, int]
    source: str

    def to_ours(self, points: NDArray[Any]) -> NDArray[Any]:
        """Coordinates [..., 3] of the file in our axes. Exact."""
        return points[..., list(self.columns)] * np.array(self.signs, points.dtype)

    def from_ours(self, points: NDArray[Any]) -> NDArray[Any]:
        """Coordinates [..., 3] of ours in the file's axes. Exact, and the inverse of `to_ours`."""
        there = np.empty_like(points)
        there[..., list(self.columns)] = points * np.array(self.signs, points.dtype)
        return there

    @property
    def told(self) -> str:
        """In words."""
        if self.columns == OURS.columns:
            return f"{self.up} up, front {self.front}: taken as it is"
        axes = ", ".join(
            ("-" if sign < 0 else "") + "xyz"[column]
            for column, sign in zip(self.columns, self.signs, strict=True)
        )
        return f"{self.up} up, front {self.front}: (x, y, z) becomes ({axes})"


OURS = Orientation("+Y", "-Z", (0, 1, 2), (1, 1, 1), "the convention of this project")
SHAPENET_V1 = Orientation(
    "+Y",
    "+X",
    (2, 1, 0),
    (1, 1, -1),
    "README.txt of ShapeNetCore.v1 (2017-08-28): up +Y, front +X, X-Y the plane of symmetry",
)
SHAPENET_V2 = Orientation(
    "+Y",
    "-Z",
    (0, 1, 2),
    (1, 1, 1),
    "README.txt of ShapeNetCore.v2 (2018-05-04): up +Y, front -Z, Y-Z the plane of symmetry",
)
MODELNET = Orientation(
    "+Z",
    "-Y",
    (0, 2, 1),
    (-1, 1, 1),
    "not stated with the data; in chair_0001.off the back is at +Y, in toilet_0001.off the bowl "
    "reaches out to -Y",
)
PAPER = Orientation(
    "+Z",
    "+X",
    (1, 2, 0),
    (-1, 1, -1),
    "ShapeNetCore.v1 as Blender imports it; the rotations of roatienza/pc2pix@23b7b46d "
    "(ball-pivoting-close-holes-mc-rotate.mlx, render_reconstruction.py) undo each other in it",
)
