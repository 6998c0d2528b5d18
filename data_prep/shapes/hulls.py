"""Solids of vehicles: streamlined bodies, wings, wheels.

Vehicles lie along z with their front towards -z, so their sections stand in the xy plane.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from data_prep.shapes.solids import Color, Part, loft, polygon

# An aerofoil's outline as (fraction of the chord, fraction of the thickness), sharp at both ends.
AEROFOIL = np.array([(0, 0), (0.25, 0.5), (0.7, 0.34), (1, 0), (0.7, -0.34), (0.25, -0.5)])


def spindle(stations: ArrayLike, color: Color, *, x: float = 0.0, sides: int = 12) -> Part:
    """Fuselage, nacelle or tank along z, of elliptical sections.

    stations  [k, 4]: z, y of the centre, half width > 0, half height > 0
    x         where it runs
    """
    z, y, half_width, half_height = np.asarray(stations, dtype=np.float64).T[:, :, None]
    circle = polygon(sides, 1.0)
    rings = np.empty((len(z), sides, 3))
    rings[..., 0] = x + half_width * circle[:, 0]
    rings[..., 1] = y + half_height * circle[:, 1]
    rings[..., 2] = z
    return loft(rings, color)


def blade(stations: ArrayLike, color: Color, *, upright: bool = False) -> Part:
    """Wing, fin or keel: aerofoils along z, joined one to the next.

    stations  [k, 5]: x, y, z of the leading edge, chord, thickness
    upright   the thickness is measured along x (a fin), otherwise along y (a wing)
    """
    given = np.asarray(stations, dtype=np.float64)
    rings = np.repeat(given[:, None, :3], len(AEROFOIL), axis=1)
    rings[..., 2] += given[:, 3:4] * AEROFOIL[:, 0]
    rings[..., 0 if upright else 1] += given[:, 4:5] * AEROFOIL[:, 1]
    return loft(rings, color)


def disc(
    centre: ArrayLike,
    radius: float,
    width: float,
    color: Color,
    *,
    bevel: float = 0.0,
    sides: int = 16,
) -> Part:
    """Wheel: a cylinder whose axle runs along x; `bevel` is taken off both rims at 45 degrees."""
    stations = [(-width / 2, radius), (width / 2, radius)]
    if bevel > 0.0:
        inner, low = width / 2 - bevel, radius - bevel
        stations = [(-width / 2, low), (-inner, radius), (inner, radius), (width / 2, low)]
    circle = polygon(sides, 1.0)
    rings = np.empty((len(stations), sides, 3))
    for ring, (x, r) in zip(rings, stations, strict=True):
        ring[:, 0] = x
        ring[:, 1:] = r * circle
    return loft(rings + np.asarray(centre, dtype=np.float64), color)


def mirrored(part: Part) -> Part:
    """The part on the other side of the plane x = 0."""
    return Part(part.vertices * (-1.0, 1.0, 1.0), part.faces[:, ::-1], part.color)


def pair(part: Part) -> list[Part]:
    """The part and its mirror image."""
    return [part, mirrored(part)]
