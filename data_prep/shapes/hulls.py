"""Solids of vehicles: streamlined bodies, wings, wheels.

Vehicles lie along z with their front towards -z, so their sections stand in the xy plane.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from data_prep.shapes.solids import Color, Part, loft, polygon, prism, sections

# An aerofoil's outline as (fraction of the chord, fraction of the thickness), sharp at both ends.
_AEROFOIL = np.array([(0, 0), (0.25, 0.5), (0.7, 0.34), (1, 0), (0.7, -0.34), (0.25, -0.5)])


def spindle(stations: ArrayLike, color: Color, *, x: float = 0.0, sides: int = 12) -> Part:
    """Return a fuselage, nacelle or tank along z, of elliptical sections.

    stations  [k, 4]: z, y of the centre, half width > 0, half height > 0
    x         where it runs
    """
    given = np.asarray(stations, dtype=np.float64)
    centres = np.stack([np.full(len(given), x), given[:, 1]], axis=1)
    return prism(2, sections(polygon(sides, 1.0), centres, given[:, 2:]), given[:, 0], color)


def blade(stations: ArrayLike, color: Color, *, upright: bool = False) -> Part:
    """Return a wing, fin or keel: aerofoils along z, joined one to the next.

    stations  [k, 5]: x, y, z of the leading edge, chord, thickness
    upright   the thickness is measured along x (a fin), otherwise along y (a wing)
    """
    given = np.asarray(stations, dtype=np.float64)
    rings = np.repeat(given[:, None, :3], len(_AEROFOIL), axis=1)
    rings[..., 2] += given[:, 3:4] * _AEROFOIL[:, 0]
    rings[..., 0 if upright else 1] += given[:, 4:5] * _AEROFOIL[:, 1]
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
    """Return a wheel: a cylinder along x; `bevel` is taken off both rims at 45 degrees."""
    stations = [(-width / 2, radius), (width / 2, radius)]
    if bevel > 0.0:
        inner, low = width / 2 - bevel, radius - bevel
        stations = [(-width / 2, low), (-inner, radius), (inner, radius), (width / 2, low)]
    x, y, z = np.asarray(centre, dtype=np.float64)
    places, radii = np.array(stations).T
    outlines = sections(polygon(sides, 1.0)[:, ::-1], [(z, y)], radii[:, None])
    return prism(0, outlines, places + x, color)


def mirrored(part: Part) -> Part:
    """Return the part on the other side of the plane x = 0."""
    return Part(part.vertices * (-1.0, 1.0, 1.0), part.faces[:, ::-1], part.color)


def pair(*parts: Part) -> list[Part]:
    """Return each part and its mirror image."""
    return [image for part in parts for image in (part, mirrored(part))]
