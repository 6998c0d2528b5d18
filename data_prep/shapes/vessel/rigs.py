"""What stands on a vessel's deck: sails, masts and houses."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from data_prep.shapes.solids import Color, Part, loft, polygon, post, tube

CLOTH = 0.008  # thickness of a sail, in lengths of the hull
# Corners of a sail's section, on its two sides, at its ends and its middle. The fan that caps the
# first and the last section begins in the middle: from an end it would have a face without area.
SIDES = ((5, 4), (0, 3), (1, 2))


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
    """Deck house between two z and two y; its upper side is `narrow` times as wide.

    lean   how far its front and its rear lean inwards from the lower to the upper side
    swell  makes it larger to both sides and both ends: a strip of windows around another house
    """
    rings = np.empty((2, 4, 3))
    for ring, share, width in zip(
        rings, (0.0, 1.0), (half_width, narrow * half_width), strict=True
    ):
        front = z[0] + share * lean[0] - swell
        rear = z[1] - share * lean[1] + swell
        side = width + swell
        ring[:] = [(-side, 0, front), (side, 0, front), (side, 0, rear), (-side, 0, rear)]
        ring[:, 1] = y[0] + share * (y[1] - y[0])
    return loft(rings, color)


def mast(foot: ArrayLike, height: float, radius: float, color: Color, rake: float = 0.0) -> Part:
    """Round mast that tapers to half of its radius; `rake` is how far its top leans back."""
    x, y, z = np.asarray(foot, dtype=np.float64)
    top = (x, y + height, z + rake)
    return post((x, y, z), top, polygon(6, radius), polygon(6, 0.5 * radius), color)


def yard(z: float, y: float, half_width: float, radius: float, color: Color) -> Part:
    """Level spar across the ship."""
    return tube([(-half_width, y, z), (half_width, y, z)], radius, color, sides=6)


def fore_and_aft_sail(low: ArrayLike, high: ArrayLike, belly: float, color: Color) -> Part:
    """Sail in the plane of the keel, from its lower edge to its upper edge.

    low, high  [2, 2]: (y, z) of the front and the rear end of each edge
    belly      how far its middle blows out to +x
    """
    edges = np.asarray([low, high], dtype=np.float64)
    rings = np.empty((5, 6, 3))
    for ring, share in zip(rings, np.linspace(0, 1, len(rings)), strict=True):
        front, rear = edges[0] + share * (edges[1] - edges[0])
        points = [front + along * (rear - front) for along in (0.0, 0.4, 1.0)]
        out = belly * math.sin(math.pi * share)
        for (one, other), point, x in zip(SIDES, points, (0.0, out, 0.0), strict=True):
            ring[one], ring[other] = (x + CLOTH / 2, *point), (x - CLOTH / 2, *point)
    return loft(rings, color)


def square_sail(
    z: float, y: tuple[float, float], half_widths: tuple[float, float], belly: float, color: Color
) -> Part:
    """Sail across the ship between two heights, blown `belly` forward in its middle."""
    rings = np.empty((5, 6, 3))
    for ring, share in zip(rings, np.linspace(0, 1, len(rings)), strict=True):
        half = half_widths[0] + share * (half_widths[1] - half_widths[0])
        height = y[0] + share * (y[1] - y[0])
        out = belly * math.sin(math.pi * share)
        for (one, other), x, forward in zip(
            SIDES, (-half, 0.0, half), (0.0, out, 0.0), strict=True
        ):
            ring[one] = (x, height, z - forward - CLOTH / 2)
            ring[other] = (x, height, z - forward + CLOTH / 2)
    return loft(rings, color)
