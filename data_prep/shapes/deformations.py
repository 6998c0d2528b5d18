"""Smooth deformations of the space that a shape stands in, drawn at random.

Coordinates are those of the shape's box: centred, the longest half extent is 1, y is up.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from data_prep.arrays import Floats
from data_prep.shapes.random_choices import chance, uniform

LATTICE = 4  # control points a side: cubic
STEP = 1e-4  # of the differences that a Jacobian is made of


@dataclass(frozen=True, eq=False)
class Deformation:
    """A smooth deformation: scale, taper, twist and bend about the vertical, then a free form.

    scale     [3], of the axes
    taper     how much wider the top is than the middle, as a share; the bottom is as much narrower
    twist     radians from the middle to the top
    bend      radians of the arc from the middle to the top, towards `bend_yaw`
    offsets   [4, 4, 4, 3], of the control points of a cubic Bernstein volume over the box -1 .. 1
              (Sederberg and Parry 1986)
    """

    scale: Floats
    taper: float
    twist: float
    bend: float
    bend_yaw: float
    offsets: Floats

    def __call__(self, points: Floats) -> Floats:
        """Return the places to which points [n, 3] move."""
        x, y, z = (points * self.scale).T
        wider = 1 + self.taper * y
        x, z = wider * x, wider * z
        x, z = _turned(x, z, self.twist * y)
        if self.bend:
            x, z = _turned(x, z, self.bend_yaw)
            radius = 1 / self.bend
            angle = y * self.bend
            x, y = radius - (radius - x) * np.cos(angle), (radius - x) * np.sin(angle)
            x, z = _turned(x, z, -self.bend_yaw)
        moved = np.stack([x, y, z], axis=1)
        return moved + self._free_form(moved)

    def _free_form(self, points: Floats) -> Floats:
        places = np.clip((points + 1) / 2, 0.0, 1.0)
        k = np.arange(LATTICE)
        binomials = np.array([math.comb(LATTICE - 1, int(i)) for i in k])
        weights = [
            binomials * places[:, [axis]] ** k * (1 - places[:, [axis]]) ** (LATTICE - 1 - k)
            for axis in range(3)
        ]
        return np.einsum("ni,nj,nk,ijkc->nc", *weights, self.offsets)

    def smallest_stretch(self, points: Floats) -> float:
        """Return the smallest determinant of the Jacobian at points [n, 3], over the mean one.

        Not above 0 where space is folded over or turned inside out.
        """
        sides = [
            (self(points + STEP * axis) - self(points - STEP * axis)) / (2 * STEP)
            for axis in np.eye(3)
        ]
        stretch = np.linalg.det(np.stack(sides, axis=1))
        return float(stretch.min() / max(abs(stretch.mean()), 1e-12))


def draw_deformation(rng: np.random.Generator) -> Deformation:
    """Return a deformation at random; each kind takes part half of the time."""

    def maybe(low_high: tuple[float, float], share: float = 0.5) -> float:
        return uniform(rng, low_high) if chance(rng, share) else 0.0

    scale = np.exp([maybe((-0.35, 0.35), 0.6) for _ in range(3)])
    strength = maybe((0.02, 0.12))
    return Deformation(
        scale=scale,
        taper=maybe((-0.3, 0.3)),
        twist=maybe((-0.35, 0.35), 0.3),
        bend=maybe((-0.45, 0.45), 0.3),
        bend_yaw=uniform(rng, (0.0, math.pi)),
        offsets=strength * rng.normal(size=(LATTICE, LATTICE, LATTICE, 3)),
    )


Turn = Callable[[Floats, Floats], tuple[Floats, Floats]]


def _turned(x: Floats, z: Floats, angle: Floats | float) -> tuple[Floats, Floats]:
    cos, sin = np.cos(angle), np.sin(angle)
    return cos * x - sin * z, sin * x + cos * z
