"""How clouds and meshes of other conventions are placed, and the way to +Y up, front towards -Z.

All are rotations by quarter turns: a permutation of the axes with signs. They round nothing, so an
object that is stored in two layouts comes out bit for bit the same.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_prep.failures import BadInput


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
    def message(self) -> str:
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
AXES = {"x": "+X", "-x": "-X", "y": "+Y", "-y": "-Y", "z": "+Z", "-z": "-Z"}  # as options say them


def upright(
    points: NDArray[np.float64], up: str = "y", front: str | None = None
) -> NDArray[np.float64]:
    """Points [N, 3] turned so that their axis `up` becomes +Y and their axis `front` -Z.

    For clouds whose user says which way they stand: scanners and maps mostly have +Z up. Both are
    one of AXES. The front is -z where it is not given, or -y where z is up or down (the
    convention of Blender: its front view looks along +Y). Exact, and values that are not finite
    stay what and where they are. Raises BadInput for what is no axis, and for a front along up.
    """
    front = front or ("-y" if up.endswith("z") else "-z")
    for name, axis in (("up", up), ("front", front)):
        if axis not in AXES:
            raise BadInput(f"{name} '{axis}': no axis; give one of {', '.join(AXES)}")
    if front[-1] == up[-1]:
        beside = ", ".join(axis for axis in AXES if axis[-1] != up[-1])
        raise BadInput(f"front '{front}': along up, which is '{up}'; give one of {beside}")
    return Orientation(AXES[up], AXES[front], "its user").to_ours(points)
