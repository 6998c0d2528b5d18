"""The cabin of a car: glass between pillars, under a roof."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from data_prep.arrays import Floats
from data_prep.shapes.solids import Color, Part, loft, post, rectangle


@dataclass(frozen=True)
class Cabin:
    """A truncated pyramid from the belt of a car (share 0 of its height) to its roof (share 1).

    foot         z of the lower edges of windscreen and rear window
    roof         z of the ends of the roof
    low, high    heights of belt and roof
    half_widths  at the belt and at the roof
    nose         how far the windscreen bulges
    """

    foot: tuple[float, float]
    roof: tuple[float, float]
    low: float
    high: float
    half_widths: tuple[float, float]
    nose: float = 0.10

    def at(self, share: float) -> tuple[float, float, float, float]:
        """Return height, z of the front, z of the rear, and half width at a share of the height."""
        ends = ((self.low, self.high), *zip(self.foot, self.roof, strict=True), self.half_widths)
        y, front, rear, half = (a + share * (b - a) for a, b in ends)
        return y, front, rear, half

    def ring(self, share: float, swell: float = 0.0) -> Floats:
        """Return the convex section [9, 3] at a share of the height, `swell` wider on all sides."""
        y, front, rear, half = self.at(share)
        front, rear, half = front - swell, rear + swell, half + swell
        right = [(0.0, front), (0.74 * half, front + self.nose), (half, front + self.nose + 0.16)]
        right += [(half, rear - 0.14), (0.78 * half, rear)]
        outline = np.array([*right, *((-x, z) for x, z in right[:0:-1])])
        return np.insert(outline, 1, y, axis=1)

    def shell(self, color: Color, swell: float, shares: tuple[float, float]) -> Part:
        """Return the solid between two shares of the height."""
        return loft([self.ring(share, swell) for share in shares], color)

    def top(self, color: Color, start: float = 0.88) -> Part:
        """Return the roof, from the share `start` on, with its edge taken off.

        It is wider than the glass.
        """
        crown = self.ring(1.0, -0.10)
        crown[:, 1] += 0.03
        return loft([self.ring(start, 0.02), self.ring(0.98, 0.02), crown], color)

    def pillars(self, color: Color, middles: tuple[float, ...], rear_width: float) -> list[Part]:
        """Return pillars at the four corners, and on the sides at shares of the length."""
        low, high = self.ring(0.03), self.ring(0.96)
        parts = []
        slim, wide = rectangle(0.085, 0.13), rectangle(0.085, rear_width)
        for side in ((1, 2, 3), (8, 7, 6)):
            front, knee, back = side
            foot, head = (0.5 * (ring[front] + ring[knee]) for ring in (low, high))
            parts.append(post(foot, head, slim, slim, color))
            inward = np.array([0.0, 0.0, 0.5 * rear_width - 0.17])
            parts.append(post(low[back] - inward, high[back] - inward, wide, wide, color))
            for share in middles:
                foot, head = (r[knee] + share * (r[back] - r[knee]) for r in (low, high))
                parts.append(post(foot, head, rectangle(0.05, 0.10), rectangle(0.05, 0.10), color))
        return parts
