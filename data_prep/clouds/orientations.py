"""Orientations of clouds and meshes, and their rotations to +Y up, front towards -Z.

All are rotations by quarter turns: a permutation of the axes with signs. They round nothing, so an
object in two layouts becomes the same, bit for bit.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_prep.failures import BadInput


@dataclass(frozen=True)
class Orientation:
    """Axes of a file that point up and to the front.

    up, front  such as "+X" or "-Z"
    source     whence this is known, in words
    """

    up: str
    front: str
    source: str

    @property
    def columns(self) -> tuple[int, ...]:
        """Return the axes (0..2) of the file that become our x, y and z, times `signs`."""
        return tuple(np.abs(self._rotation()).argmax(axis=1).tolist())

    @property
    def signs(self) -> tuple[int, ...]:
        """Return 1 or -1 for our x, y and z."""
        return tuple(self._rotation().sum(axis=1).tolist())

    def _rotation(self) -> NDArray[np.int64]:
        """Return a matrix [3, 3] whose rows are our axes in the axes of the file."""
        top, ahead = _direction(self.up), _direction(self.front)
        return np.stack([np.cross(ahead, top), top, -ahead])

    def to_ours(self, points: NDArray[Any]) -> NDArray[Any]:
        """Return coordinates [..., 3] of the file in our axes, without rounding."""
        # Not a matrix product, where an infinite x would make NaN of y and z.
        return points[..., list(self.columns)] * np.array(self.signs, points.dtype)

    def to_file(self, points: NDArray[Any]) -> NDArray[Any]:
        """Return coordinates [..., 3] in our axes in those of the file, without rounding."""
        turned = np.empty_like(points)
        turned[..., list(self.columns)] = points * np.array(self.signs, points.dtype)
        return turned

    @property
    def message(self) -> str:
        """Return the orientation in words."""
        if self.columns == OURS.columns:
            return f"{self.up} up, front {self.front}: taken as it is"
        axes = []
        for column, sign in zip(self.columns, self.signs, strict=True):
            axis = "xyz"[column]
            axes.append(f"-{axis}" if sign < 0 else axis)
        return f"{self.up} up, front {self.front}: (x, y, z) becomes ({', '.join(axes)})"


def _direction(axis: str) -> NDArray[np.int64]:
    """Return the unit vector [3] of an axis such as "-Z"."""
    direction = np.zeros(3, np.int64)
    direction["XYZ".index(axis[1])] = -1 if axis[0] == "-" else 1
    return direction


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
AXES = {"x": "+X", "-x": "-X", "y": "+Y", "-y": "-Y", "z": "+Z", "-z": "-Z"}  # names in options


def upright(
    points: NDArray[np.float64], up: str = "y", front: str | None = None
) -> NDArray[np.float64]:
    """Turn points [N, 3] so that their axis `up` becomes +Y and their axis `front` -Z.

    Nothing is rounded. The axes are as in `orientation_of`, which states the errors.
    """
    return orientation_of(up, front).to_ours(points)


def orientation_of(up: str = "y", front: str | None = None) -> Orientation:
    """Return the orientation of a file whose axes `up` and `front` its user names.

    Both are one of AXES. The default front is -z, or -y where z is up or down (the convention of
    Blender: its front view looks along +Y). Raises BadInput for an unknown axis, and for a front
    along up.
    """
    front = front or ("-y" if str(up).endswith("z") else "-z")
    for name, axis in (("up", up), ("front", front)):
        if axis not in AXES:
            raise BadInput(f"{name} '{axis}': no axis; give one of {', '.join(AXES)}")
    if front[-1] == up[-1]:
        beside = ", ".join(axis for axis in AXES if axis[-1] != up[-1])
        raise BadInput(f"front '{front}': along up, which is '{up}'; give one of {beside}")
    return Orientation(AXES[up], AXES[front], "its user")
