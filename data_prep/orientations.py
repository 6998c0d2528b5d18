"""How clouds and meshes of other conventions are placed, and the way to +Y up, front towards -Z.

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
    """Which axes of a file point up and to the front; they become +Y and -Z.

    up, front  two of "+X", "-X", "+Y", "-Y", "+Z", "-Z", not along the same axis
    source     where that is stated, or how it was found
    """

    up: str
    front: str
    source: str

    @property
    def columns(self) -> tuple[int, int, int]:
        """Our x, y and z are these axes (0..2) of the file, times `signs`."""
        x, y, z = np.abs(self._rotation()).argmax(axis=1).tolist()
        return x, y, z

    @property
    def signs(self) -> tuple[int, int, int]:
        """1 or -1 for our x, y and z."""
        x, y, z = self._rotation().sum(axis=1).tolist()
        return x, y, z

    def _rotation(self) -> NDArray[np.int64]:
        """[3, 3]; its rows are our axes in those of the file."""
        top, ahead = _unit(self.up), _unit(self.front)
        return np.stack([np.cross(ahead, top), top, -ahead])

    def to_ours(self, points: NDArray[Any]) -> NDArray[Any]:
        """Coordinates [..., 3] of the file in our axes. Exact.

        Values that are not finite stay what and where they are, but for their signs.
        """
        # Not a matrix product, where an infinite x would make NaN of y and z.
        return points[..., list(self.columns)] * np.array(self.signs, points.dtype)

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


def _unit(axis: str) -> NDArray[np.int64]:
    """The unit vector [3] of "+X" ... "-Z"."""
    vector = np.zeros(3, np.int64)
    vector["XYZ".index(axis[1])] = {"+": 1, "-": -1}[axis[0]]
    return vector


OURS = Orientation("+Y", "-Z", "the convention of this project")
SHAPENET_V1 = Orientation(
    "+Y",
    "+X",
    "README.txt of ShapeNetCore.v1 (2017-08-28): up +Y, front +X, X-Y the plane of symmetry",
)
SHAPENET_V2 = Orientation(
    "+Y",
    "-Z",
    "README.txt of ShapeNetCore.v2 (2018-05-04): up +Y, front -Z, Y-Z the plane of symmetry",
)
MODELNET = Orientation(
    "+Z",
    "-Y",
    "not stated with the data; in chair_0001.off the back is at +Y, in toilet_0001.off the bowl "
    "reaches out to -Y",
)
PAPER = Orientation(
    "+Z",
    "+X",
    "ShapeNetCore.v1 as Blender imports it; the rotations of roatienza/pc2pix@23b7b46d "
    "(ball-pivoting-close-holes-mc-rotate.mlx, render_reconstruction.py) undo each other in it",
)
