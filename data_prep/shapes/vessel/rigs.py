"""Structures on a vessel's deck: sails, masts, funnels and houses."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from data_prep.arrays import Floats
from data_prep.shapes.solids import Color, Part, loft, polygon, post, prism, tube

CLOTH = 0.008  # thickness of a sail, in lengths of the hull
# Corners of a sail's section, on its two sides, at its ends and its middle. The fan that caps the
# first and the last section begins in the middle: from an end it would have a face without area.
SIDES = ((5, 4), (0, 3), (1, 2))
_SHARES = np.linspace(0.0, 1.0, 5)  # of a sail's height, at its sections


def house(
    z: tuple[float, float],
    y: tuple[float, float],
    half_width: float,
    color: Color,
    *,
    lean: tuple[float, float] = (0.0, 0.0),
    narrow: float = 1.0,
    swell: float = 0.0,
) -> Part:
    """Return a deck house between two z and two y; its upper side is `narrow` times as wide.

    lean   how far its front and its rear lean inwards from the lower to the upper side
    swell  makes it larger to both sides and both ends: a strip of windows around another house
    """
    plans = []
    for share, width in ((0.0, half_width), (1.0, narrow * half_width)):
        front = z[0] + share * lean[0] - swell
        rear = z[1] - share * lean[1] + swell
        side = width + swell
        plans.append([(-side, front), (side, front), (side, rear), (-side, rear)])
    return prism(1, plans, (y[0], y[0] + (y[1] - y[0])), color)


def mast(foot: ArrayLike, height: float, radius: float, color: Color, rake: float = 0.0) -> Part:
    """Return a round mast that tapers to half of its radius; its top leans back by `rake`."""
    x, y, z = np.asarray(foot, dtype=np.float64)
    top = (x, y + height, z + rake)
    return post((x, y, z), top, polygon(6, radius), polygon(6, 0.5 * radius), color)


def yard(z: float, y: float, half_width: float, radius: float, color: Color) -> Part:
    """Return a level spar across the ship."""
    return tube([(-half_width, y, z), (half_width, y, z)], radius, color, sides=6)


def fore_and_aft_sail(low: ArrayLike, high: ArrayLike, belly: float, color: Color) -> Part:
    """Return a sail in the plane of the keel, from its lower edge to its upper edge.

    low, high  [2, 2]: (y, z) of the front and the rear end of each edge
    belly      how far its middle blows out to +x
    """
    edges = np.asarray([low, high], dtype=np.float64)
    points = np.zeros((5, 3, 3))
    for ring, share in zip(points, _SHARES, strict=True):
        front, rear = edges[0] + share * (edges[1] - edges[0])
        ring[:, 1:] = [front + along * (rear - front) for along in (0.0, 0.4, 1.0)]
    points[:, 1, 0] = [belly * math.sin(math.pi * share) for share in _SHARES]
    return _sail(points, (CLOTH / 2, 0.0, 0.0), color)


def square_sail(
    z: float, y: tuple[float, float], half_widths: tuple[float, float], belly: float, color: Color
) -> Part:
    """Return a sail across the ship between two heights, blown `belly` forward in its middle."""
    points = np.zeros((5, 3, 3))
    for ring, share in zip(points, _SHARES, strict=True):
        half = half_widths[0] + share * (half_widths[1] - half_widths[0])
        ring[:, 0] = (-half, 0.0, half)
        ring[:, 1] = y[0] + share * (y[1] - y[0])
        ring[:, 2] = (z, z - belly * math.sin(math.pi * share), z)
    return _sail(points, (0.0, 0.0, -CLOTH / 2), color)


def _sail(points: Floats, half: tuple[float, float, float], color: Color) -> Part:
    """Return a cloth about points [5, 3, 3], from below and from edge to edge.

    `half` is half of its thickness.
    """
    rings = np.empty((5, 6, 3))
    for k, (front, back) in enumerate(SIDES):
        rings[:, front], rings[:, back] = points[:, k] + half, points[:, k] - half
    return loft(rings, color)


def funnel_parts(
    z: float, y: float, height: float, radius: float, color: Color, tip: Color
) -> list[Part]:
    """Return a funnel that leans back, with a dark top standing out of it."""
    shape = polygon(8, radius) * (0.7, 1.2)
    lean = 0.15 * height
    top = (0.0, y + height, z + lean)
    cap = (0.0, y + 0.80 * height, z + 0.80 * lean)
    peak = (0.0, y + height + 0.008, z + lean)
    return [post((0, y, z), top, shape, 0.9 * shape, color), post(cap, peak, shape, shape, tip)]
