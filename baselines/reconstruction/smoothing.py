"""Smoothing: noisy points are moved onto the surface that they scatter about.

The method is moving least squares by iterated projection (Alexa et al., Computing and rendering
point set surfaces, IEEE TVCG 9(1), 2003): each point moves along the normal of its neighbourhood
onto a height field of degree 2 over the neighbourhood's plane, fitted by weighted least squares (a
jet: Cazals and Pouget, Estimating differential quantities using polynomial fitting of osculating
jets, CAGD 22(2), 2005).
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from data_prep.arrays import Floats

_SHARPNESS = 2.0  # a neighbour's weight is exp(-SHARPNESS (distance / that of the farthest)^2)
_TERMS = 6  # of a polynomial of degree 2 in two variables
_RIDGE = 1e-9  # keeps fits defined that the points do not determine: a line, few points


def smoothed(points: Floats, neighbours: int, rounds: int) -> Floats:
    """Return points [N, 3] projected `rounds` times onto height fields of their neighbours.

    A height field is fitted to the `neighbours` nearest points.

    Planes and paraboloids stay as they are, to rounding; 0 rounds change nothing. Of fewer points
    than `neighbours` all are neighbours.
    """
    for _ in range(rounds):
        points = _projected(points, min(neighbours, len(points)))
    return points


def _projected(points: Floats, neighbours: int) -> Floats:
    distance, index = map(np.asarray, cKDTree(points).query(points, k=neighbours))
    farthest = np.maximum(distance[:, -1:], np.finfo(np.float64).tiny)
    weight = np.exp(-_SHARPNESS * (distance / farthest) ** 2)[..., None]
    near = points[index]
    centre = (weight * near).sum(axis=1, keepdims=True) / weight.sum(axis=1, keepdims=True)
    offset = near - centre
    _, axes = np.linalg.eigh(np.swapaxes(weight * offset, 1, 2) @ offset)
    height, a, b = np.moveaxis((near - points[:, None]) @ axes, 2, 0) / farthest
    terms = np.stack([np.ones_like(a), a, b, a * a, a * b, b * b], axis=2)
    weighted = np.swapaxes(weight * terms, 1, 2)
    matrix = weighted @ terms + _RIDGE * weight.sum(axis=1)[..., None] * np.eye(_TERMS)
    fit = np.linalg.solve(matrix, weighted @ height[..., None])[:, 0]
    return points + fit * farthest * axes[:, :, 0]


def dense_part(points: Floats, share: float, neighbours: int) -> Floats:
    """Return the densest `share` (0..1) of points [N, 3], in their order.

    A point is the denser the nearer the point `neighbours` away is; of equally dense ones the first
    are taken.
    """
    kept = round(share * len(points))
    if kept >= len(points):
        return points
    distance, _ = cKDTree(points).query(points, k=[min(neighbours, len(points))])
    return points[np.sort(np.argsort(np.ravel(distance), kind="stable")[:kept])]
