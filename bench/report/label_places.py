"""Where labels of points have room in a figure. Pure geometry."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
RINGS = (9, 14, 20, 28, 38, 50, 64)  # distances tried around a point, in points of 1/72 inch
DIRECTIONS_DEG = (90, 270, 45, 135, 315, 225, 0, 180, 67, 113, 247, 293)  # above, below, ...


def place_labels(anchors: Floats, sizes: Floats, obstacles: Floats, area: Floats) -> Floats:
    """Centres [n, 2] of labels of these sizes [n, 2], each near its anchor [n, 2].

    obstacles [m, 4] and area [4] are boxes (left, bottom, right, top). One label after the other
    takes the nearest of the places around its anchor where it covers neither an obstacle nor a
    label before it and stays inside the area; where there is none, the one that covers least.
    """
    angles = np.radians(DIRECTIONS_DEG)
    around = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    taken = obstacles.reshape(-1, 4)
    centres = np.empty_like(anchors)
    for i, (anchor, size) in enumerate(zip(anchors, sizes, strict=True)):
        # A wide label is moved further aside than up, so that its edge keeps the distance.
        steps = [around * (ring + (size - size.min()) / 2 * np.abs(around)) for ring in RINGS]
        tried = anchor + np.concatenate(steps)
        boxes = np.concatenate([tried - size / 2, tried + size / 2], axis=1)
        cost = covered(boxes, taken) + _outside(boxes, area)
        best = int(cost.argmin())  # of equals the first, which is the nearest
        centres[i] = tried[best]
        taken = np.concatenate([taken, boxes[best : best + 1]])
    return centres


def covered(boxes: Floats, others: Floats) -> Floats:
    """Area of each box [n, 4] that the others [m, 4] cover, [n]; twice what is covered twice."""
    low = np.maximum(boxes[:, None, :2], others[None, :, :2])
    high = np.minimum(boxes[:, None, 2:], others[None, :, 2:])
    return np.clip(high - low, 0, None).prod(axis=2).sum(axis=1)


def _outside(boxes: Floats, area: Floats) -> Floats:
    whole = (boxes[:, 2:] - boxes[:, :2]).prod(axis=1)
    return whole - covered(boxes, area[None])
