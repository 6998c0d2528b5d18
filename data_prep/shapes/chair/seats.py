"""Seats, and the places on a seat where the other parts of a chair meet it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from data_prep.arrays import Floats
from data_prep.shapes.chair.spec import ChairSpec
from data_prep.shapes.solids import Part, polygon, rectangle, rim, rounded, slab

# Families whose cushion is let into a frame of rails; elsewhere the whole seat is upholstered.
_FRAMED = ("four-leg", "rocker")
# Faces of a leg and of the seat it is sunk into must not lie in one plane (they would flicker).
_CLEAR_M = 0.006


@dataclass(frozen=True, eq=False)
class Layout:
    """The places of a chair's parts: x to the side, y up from the floor, z to the rear; metres.

    outline   [n, 2], the seat's edge in (x, z), anticlockwise
    top       the seat's upper side, without a cushion let into a frame
    bottom    its lower side
    post      (x, z) of the right post of the back
    front     (x, z) of the right front leg
    """

    outline: Floats
    top: float
    bottom: float
    post: tuple[float, float]
    front: tuple[float, float]
    tilt_rad: float

    @property
    def middle(self) -> float:
        """Return the height half-way up the seat's thickness, where posts and legs end."""
        return (self.top + self.bottom) / 2

    def from_back(self, points: ArrayLike) -> Floats:
        """Return points [..., 3] of the leaning back's own frame in the chair's.

        The frame's origin is on the seat between the posts; x is to the side, y up along the back,
        z to the rear, across it.
        """
        x, y, z = np.moveaxis(np.asarray(points, dtype=np.float64), -1, 0)
        cos, sin = math.cos(self.tilt_rad), math.sin(self.tilt_rad)
        return np.stack(
            [x, self.top + y * cos - z * sin, self.post[1] + y * sin + z * cos], axis=-1
        )


def lay_out(spec: ChairSpec) -> Layout:
    """Return the layout that a description implies."""
    width, depth, leg = spec.seat_width_m, spec.seat_depth_m, spec.leg_m
    rear = width * (spec.rear if spec.seat == "trapezoid" else 1.0)
    margin = leg / 2 + _CLEAR_M
    if spec.seat == "round":
        outline = polygon(20, 0.5) * (width, depth)
        post = (0.66 * width / 2, 0.74 * depth / 2 - margin)
        front = (0.62 * width / 2, -0.62 * depth / 2)
    else:
        radius = 0.11 if spec.seat == "rounded" else 0.025
        corners = np.array([[-width, -depth], [width, -depth], [rear, depth], [-rear, depth]]) / 2
        outline = rounded(corners, radius)
        margin += radius / 4  # the curve of `rounded` passes its corner at a quarter of the radius
        post = (rear / 2 - margin, depth / 2 - margin)
        front = (width / 2 - margin, margin - depth / 2)
    if spec.family in ("sled", "cantilever"):  # the frame's tubes run along the edge of the seat
        post = (width / 2 + 0.2 * leg, depth / 2 - 0.05)
    thickness = spec.seat_thickness_m
    if spec.cushion and spec.family not in _FRAMED:
        thickness += spec.cushion_m / 2
    return Layout(
        outline=outline,
        top=spec.seat_height_m,
        bottom=spec.seat_height_m - thickness,
        post=post,
        front=front,
        tilt_rad=math.radians(spec.rake_deg),
    )


def seat_parts(spec: ChairSpec, layout: Layout) -> list[Part]:
    """Return the seat: a plate, an upholstered plate, or a frame with a cushion in it."""
    outline, top, bottom = layout.outline, layout.top, layout.bottom
    size = np.ptp(outline, axis=0)
    unit = outline / size
    if not spec.cushion:
        plate = slab(
            unit,
            (0.0, layout.middle, 0.0),
            (size[0], top - bottom, size[1]),
            spec.seat_color,
            bevel=0.005,
        )
        if not spec.apron:
            return [plate]
        rails = rim(0.93 * outline, bottom - 0.05, bottom + 0.004, 0.018, spec.frame_color)
        return [plate, rails]
    if spec.family not in _FRAMED:
        bevel = 0.35 * (top - bottom)
        centre, height = (0.0, layout.middle, 0.0), top - bottom
        return [slab(unit, centre, (size[0], height, size[1]), spec.seat_color, bevel=bevel)]
    rails = rim(outline, bottom - 0.02, top, 0.035, spec.frame_color)
    # The cushion fills the frame, so that next to nothing of it is hidden.
    height = spec.cushion_m
    low = top - 0.4 * (top - bottom)
    cushion = slab(
        unit,
        (0.0, low + height / 2, 0.0),
        (size[0] - 0.05, height, size[1] - 0.05),
        spec.seat_color,
        bevel=0.012,
    )
    return [rails, cushion]


def bar_section(spec: ChairSpec, thickness: float) -> Floats:
    """Return the section of a leg or post: round or square, as the chair has it."""
    return polygon(8, thickness / 2) if spec.round_legs else rectangle(thickness, thickness)
