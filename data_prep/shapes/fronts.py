"""Parts that look towards the front: plates, frames and turned parts, upright, facing -Z."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from data_prep.arrays import Floats
from data_prep.shapes.solids import (
    Color,
    Part,
    lathe,
    moved,
    rectangle,
    rim,
    rounded,
    slab,
)


def panel(
    centre: ArrayLike,
    size: ArrayLike,
    color: Color,
    *,
    corner: float = 0.0,
    bevel: float = 0.0,
    steps: int = 2,
) -> Part:
    """Return an upright plate: width, height and thickness [3] around a centre [3].

    `corner` rounds its four corners as seen from the front, in `steps`; it has to be less than half
    of width and height. `bevel` takes that length off the edges of front and back at 45 degrees; it
    has to be less than half of the thickness, and less than half of the `corner` if there is one.
    """
    width, height, thickness = np.asarray(size, dtype=np.float64)
    outline = _outline(width, height, corner, steps) / (width, height)
    lying = slab(outline, (0, 0, 0), (width, thickness, height), color, bevel=bevel)
    return moved(lying, centre, tilt_rad=math.pi / 2)


def frame(
    centre: ArrayLike, size: ArrayLike, border: float, color: Color, *, corner: float = 0.0
) -> Part:
    """Return an upright frame around an opening: outer width, outer height and thickness [3].

    `border` is the width of its bars, less than half of width and height; `corner` as for a panel.
    """
    width, height, thickness = np.asarray(size, dtype=np.float64)
    outline = _outline(width, height, corner)
    lying = rim(outline, -thickness / 2, thickness / 2, border, color)
    return moved(lying, centre, tilt_rad=math.pi / 2)


def dial(centre: ArrayLike, profile: ArrayLike, color: Color, *, sides: int = 12) -> Part:
    """Return a solid turned about an axis that points to the front.

    profile  [k, 2] of (radius > 0, distance in front of the centre), from one end on
    """
    return moved(lathe(profile, color, sides=sides), centre, tilt_rad=-math.pi / 2)


def _outline(width: float, height: float, corner: float, steps: int = 2) -> Floats:
    outline = rectangle(width, height)
    return rounded(outline, corner, steps) if corner > 0.0 else outline
