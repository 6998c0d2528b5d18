"""Clouds whose user says which way they stand, turned to +Y up, the front towards -Z.

Scanners and maps mostly have +Z up.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from data_prep.failures import BadInput
from data_prep.orientations import Orientation

AXES = {"x": "+X", "-x": "-X", "y": "+Y", "-y": "-Y", "z": "+Z", "-z": "-Z"}  # as options say them


def upright(
    points: NDArray[np.float64], up: str = "y", front: str | None = None
) -> NDArray[np.float64]:
    """Points [N, 3] turned so that their axis `up` becomes +Y and their axis `front` -Z.

    Both are one of AXES. The front is -z where it is not given, or -y where z is up or down (the
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
