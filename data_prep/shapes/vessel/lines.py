"""The lines of a ship's hull, and the solids between two of its heights.

Lengths are in hulls: the bow is at z = -0.5, the stern at z = 0.5, the water at y = 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from data_prep.arrays import Floats
from data_prep.shapes.solids import Color, Part, loft

STATIONS = np.array([0.0, 0.03, 0.08, 0.16, 0.26, 0.40, 0.56, 0.72, 0.85, 0.94, 1.0])


@dataclass(frozen=True)
class Lines:
    """A hull of length 1 from the bow at z = -0.5 to the stern at z = 0.5; y = 0 is the waterline.

    half_beam   half of the greatest width
    draft       depth of the keel
    freeboard   height of the deck amidships
    sheer       how much higher the deck is at bow and stern
    entry       share of the length over which the bow widens
    stern       width at the stern, in beams
    fullness    exponent of the sections: 0.1 a box, 1 a wedge; all bows are wedges
    rake        how far the stem leans forward between keel and deck
    rocker      how far the keel rises at both ends, in drafts
    """

    half_beam: float
    draft: float
    freeboard: float
    sheer: tuple[float, float] = (0.02, 0.005)
    entry: float = 0.3
    stern: float = 0.7
    fullness: float = 0.2
    rake: float = 0.04
    rocker: float = 0.0

    @property
    def deck(self) -> Floats:
        """Return the height of the deck's edge at STATIONS."""
        fore, aft = np.clip(1 - STATIONS / 0.5, 0, 1), np.clip(STATIONS / 0.5 - 1, 0, 1)
        return self.freeboard + self.sheer[0] * fore**2 + self.sheer[1] * aft**2

    @property
    def keel(self) -> Floats:
        """Return the height of the keel at STATIONS."""
        return -self.draft * (1 - self.rocker * (2 * STATIONS - 1) ** 2)

    def deck_at(self, z: float) -> float:
        """Return the height of the deck's edge at z."""
        return float(np.interp(z + 0.5, STATIONS, self.deck))

    def half_width_at(self, z: float, below: float = 0.0) -> float:
        """Return the half width of the hull at z, `below` the edge of the deck."""
        widths = self._side((self.deck - below)[:, None])[:, 0, 0]
        return float(np.interp(z + 0.5, STATIONS, widths))

    def _deck_width(self) -> Floats:
        bow = 1 - (1 - np.clip(STATIONS / self.entry, 0.0, 1.0)) ** 2
        stern = 1 - (1 - self.stern) * np.clip((STATIONS - 0.6) / 0.4, 0.0, 1.0) ** 2
        return self.half_beam * np.maximum(bow, 0.03) * stern

    def _side(self, heights: Floats) -> Floats:
        """Return the right side [S, n, 3] at the given heights [S, n], one row a station."""
        share = (heights - self.keel[:, None]) / (self.deck - self.keel)[:, None]
        share = np.clip(share, 0.0, 1.0)
        sharp = np.clip(1 - STATIONS / (1.6 * self.entry), 0.0, 1.0)
        exponent = self.fullness + (0.9 - self.fullness) * sharp
        side = np.empty((*heights.shape, 3))
        side[..., 0] = self._deck_width()[:, None] * (0.06 + 0.94 * share ** exponent[:, None])
        side[..., 1] = heights
        lean = np.clip(1 - STATIONS / 0.3, 0.0, 1.0) ** 2
        side[..., 2] = STATIONS[:, None] - 0.5 + self.rake * lean[:, None] * (1 - share)
        return side

    def between(
        self, low: ArrayLike, high: ArrayLike, color: Color, *, swell: float = 0.0, levels: int = 4
    ) -> Part:
        """Return the hull between two heights: numbers, or one a station.

        Above the deck it goes upright.

        `swell` widens it (in x and z) on all sides, so that it stands out of its neighbours.
        """
        low, high = np.broadcast_arrays(low, high, STATIONS)[:2]
        share = np.linspace(0.0, 1.0, levels) ** 1.5
        side = self._side(low[:, None] + (high - low)[:, None] * share)
        # A stem has some width, more above than below, so that no face of its end is without area.
        side[..., 0] = np.maximum(side[..., 0] + swell, 0.0) + 0.001 * (1 + np.sqrt(share))
        side[..., 2] *= 1 + 2 * swell
        return loft(np.concatenate([side, side[:, ::-1] * (-1, 1, 1)], axis=1), color)

    def open_boat(self, depth: float, wall: float, color: Color, *, fore: float = 0.1) -> Part:
        """Return the hull with a well `depth` deep between sides `wall` thick, decked at both ends.

        fore  share of the length that is decked at the bow
        """
        share = np.linspace(0.0, 1.0, 4) ** 1.5
        outer = self._side(self.keel[:, None] + (self.deck - self.keel)[:, None] * share)
        inner = outer[:, -1:].repeat(2, axis=1)
        open_ = (fore < STATIONS) & (STATIONS < 0.95)
        inner[:, 1, 0] = np.minimum(
            self._side((self.deck - depth)[:, None])[:, 0, 0], inner[:, 0, 0]
        )
        inner[..., 0] = np.maximum(inner[..., 0] - (wall, wall + 0.004), 0.5 * inner[..., 0])
        # The decks at the ends are crowned, so that their sections are convex.
        inner[:, 0, 1] += 0.002
        inner[:, 1, 1] += np.where(open_, -depth, 0.003)
        half = np.concatenate([outer, inner], axis=1)
        return loft(np.concatenate([half, half[:, ::-1] * (-1, 1, 1)], axis=1), color)


def decked_hull(
    lines: Lines, side: Color, bottom: Color, deck: Color, waterline: float
) -> list[Part]:
    """Return a hull in two colours, parted at the height `waterline`.

    A deck is let into its top.
    """
    parts = [
        lines.between(waterline - 0.008, lines.deck, side),
        lines.between(lines.keel, waterline, bottom, swell=0.003),
    ]
    inset = 0.12 * lines.half_beam
    parts.append(lines.between(lines.deck - 0.01, lines.deck + 0.006, deck, swell=-inset, levels=2))
    return parts
