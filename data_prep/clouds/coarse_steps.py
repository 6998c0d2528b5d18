"""Coordinates that were rounded when they were stored: the cloud lies in slices."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from data_prep.clouds.sampling import random_rows

LEAST_SHARE = 0.01  # of the size of the cloud: finer steps are not seen
_MOST_SAMPLED = 4096  # points that are looked at; of more, a random subset
FEWEST_POINTS, FEWEST_LEVELS = 64, 3  # the faces of a box have two


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
    rounded = (single == points).all(axis=0) & (spacing > LEAST_SHARE * size)
    if rounded.any():
        axis = int(np.argmax(np.where(rounded, spacing, 0)))
        step, why = max(spacing[axis], steps[axis]), f"float32 at {magnitude[axis]:.3g}"
        remedy = "shift them before they are saved, or save doubles"
    elif coarse.sum() > 1 or (coarse & (np.frexp(steps.astype(np.float32))[0] == 0.5)).any():
        step, why, remedy = (
            steps.max(),
            "voxels, few digits, or float32 before a shift",
            "save more digits of a rounded one",
        )
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
    counts = gaps / gaps.min()
    return float(gaps.min()) if (np.abs(counts - np.rint(counts)) < 0.01).all() else 0.0
