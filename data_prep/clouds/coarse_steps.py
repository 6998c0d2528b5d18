"""Coordinates that were rounded when they were stored: the cloud lies in slices."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from data_prep.clouds.sampling import random_rows

LEAST_SHARE = 0.01  # of the size of the cloud, about a pixel of its image: finer steps are not seen
_MOST_SAMPLED = 4096  # points that are looked at, of larger clouds a random subset: for speed
FEWEST_POINTS = 64  # of a cloud that is looked at: a few points may lie in a grid by chance
FEWEST_LEVELS = 3  # different values on an axis: the faces of a box, which is no fault, have two
_WHOLE = 0.01  # of a step: so near a whole number of steps a gap counts as one


def note_on_steps(points: NDArray[np.float64]) -> str | None:
    """Return a sentence on the steps of coordinates [N, 3] where they can be seen, else None.

    Steps are those of float32 at the place of the cloud, on any axis, if all its coordinates are
    float32; or those of a grid on two axes, or on one in a power of two, as float32 that was
    shifted afterwards has. Points that are not finite do not count.
    """
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) < FEWEST_POINTS:
        return None
    points = points[random_rows(len(points), _MOST_SAMPLED)]
    size = float(np.ptp(points, axis=0).max())
    if size == 0:
        return None
    with np.errstate(over="ignore"):
        single = points.astype(np.float32)
    magnitude = np.abs(single).max(axis=0)
    spacing = np.spacing(magnitude).astype(np.float64)
    steps = np.array([_step(axis) for axis in points.T])
    coarse = steps > LEAST_SHARE * size
    is_power_of_two = np.frexp(steps.astype(np.float32))[0] == 0.5  # 1/2 times a power of two
    rounded = (single == points).all(axis=0) & (spacing > LEAST_SHARE * size)
    if rounded.any():
        axis = int(np.argmax(np.where(rounded, spacing, 0)))
        step = max(spacing[axis], steps[axis])
        why = f"float32 at {magnitude[axis]:.3g}"
        remedy = "shift them before they are saved, or save doubles"
    elif coarse.sum() > 1 or (coarse & is_power_of_two).any():
        step = steps.max()
        why = "voxels, few digits, or float32 before a shift"
        remedy = "save them with more digits if they were rounded"
    else:
        return None
    return (
        f"coordinates are in steps of {step:.3g} where the object is {size:.3g} across ({why}), "
        f"which shows as slices; {remedy}"
    )


def _step(values: NDArray[np.float64]) -> float:
    """Return the step of the grid that values [N] lie on, 0 without one."""
    gaps = np.diff(np.unique(values))
    if len(gaps) < FEWEST_LEVELS - 1:
        return 0.0
    in_steps = gaps / gaps.min()
    if (np.abs(in_steps - np.rint(in_steps)) >= _WHOLE).any():
        return 0.0
    return float(gaps.min())
