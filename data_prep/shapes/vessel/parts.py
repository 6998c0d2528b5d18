"""What several vessels share: their colours, a decked hull, funnels.

Lengths are in hulls: the bow is at z = -0.5, the stern at z = 0.5, the water at y = 0.
"""

from __future__ import annotations

from data_prep.shapes.solids import Color, Part, polygon, post
from data_prep.shapes.vessel.lines import Lines


def decked_hull(
    lines: Lines, side: Color, bottom: Color, deck: Color, waterline: float
) -> list[Part]:
    """Hull in two colours, parted at the height `waterline`, and a deck let into its top."""
    parts = [
        lines.between(waterline - 0.008, lines.deck, side),
        lines.between(lines.keel, waterline, bottom, swell=0.003),
    ]
    inset = 0.12 * lines.half_beam
    parts.append(lines.between(lines.deck - 0.01, lines.deck + 0.006, deck, swell=-inset, levels=2))
    return parts


def funnel_parts(
    z: float, y: float, height: float, radius: float, color: Color, tip: Color
) -> list[Part]:
    """A funnel that leans back, with a dark top standing out of it."""
    shape = polygon(8, radius) * (0.7, 1.2)
    lean = 0.15 * height
    top = (0.0, y + height, z + lean)
    cap = (0.0, y + 0.80 * height, z + 0.80 * lean)
    peak = (0.0, y + height + 0.008, z + lean)
    return [post((0, y, z), top, shape, 0.9 * shape, color), post(cap, peak, shape, shape, tip)]
