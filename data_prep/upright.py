"""Clouds of other conventions, turned to ours: +Y up, the front towards -Z.

Scanners and maps mostly have +Z up. The turns are by right angles, hence exact: coordinates change
places and signs, nothing else.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from data_prep.failures import BadInput

AXES = {
    "x": (1, 0, 0), "-x": (-1, 0, 0),
    "y": (0, 1, 0), "-y": (0, -1, 0),
    "z": (0, 0, 1), "-z": (0, 0, -1),
}  # fmt: skip


def upright(
    points: NDArray[np.float64], up: str = "y", front: str | None = None
) -> NDArray[np.float64]:
    """Points [N, 3] turned so that their axis `up` becomes +Y and their axis `front` -Z.

    Both are one of AXES. The front is -z where it is not given, or -y where z is up or down (the
    convention of Blender: its front view looks along +Y). Values that are not finite stay what and
    where they are. Raises BadInput for what is no axis, and for a front along up.
    """
    front = front or ("-y" if up.endswith("z") else "-z")
    for name, axis in (("up", up), ("front", front)):
        if axis not in AXES:
            raise BadInput(f"{name} '{axis}': no axis; give one of {', '.join(AXES)}")
    if front[-1] == up[-1]:
        beside = ", ".join(axis for axis in AXES if axis[-1] != up[-1])
        raise BadInput(f"front '{front}': along up, which is '{up}'; give one of {beside}")
    top, ahead = np.array(AXES[up]), np.array(AXES[front])
    rotation = np.stack([np.cross(ahead, top), top, -ahead])
    # Not a matrix product, where an infinite x would make NaN of y and z.
    return points[:, np.abs(rotation).argmax(axis=1)] * rotation.sum(axis=1)
