"""The points that a method of bounded cost reconstructs from."""

from __future__ import annotations

import numpy as np

from baselines.reconstruction.stages import check_points
from baselines.reconstruction.surface_fit import in_sight
from data_prep.failures import StageFailure
from data_prep.scene import PointCloud, Points


def used_points(
    cloud: PointCloud, least: int, most: int, what: str
) -> tuple[Points, tuple[str, ...]]:
    """Return the different points [M, 3] in sight, sorted by coordinates, and notes.

    The notes say which points were left out.

    Points as far away as the camera or farther are out of sight. Of more than `most` points every
    nth is taken. Neither the order of the points nor repeated ones change the result.

    Raises StageFailure("input", ...) where fewer than `least`, which `what` need, are left, and
    where a point is not finite.
    """
    check_points(cloud.points, least, what)
    seen = in_sight(cloud.points)
    different = np.unique(seen, axis=0)
    if len(different) < least:
        raise StageFailure(
            "input",
            f"{len(different)} of {len(cloud)} points are different and nearer than the camera; "
            f"{what} need at least {least}",
        )
    used = different[:: -(-len(different) // most)]
    notes = []
    if len(seen) < len(cloud):
        far = len(cloud) - len(seen)
        notes.append(f"input: {far} of {len(cloud)} points left out, they lie beyond the camera")
    if len(used) < len(different):
        notes.append(f"input: {len(used)} of {len(different)} points used")
    return used, tuple(notes)
