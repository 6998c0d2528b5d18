"""Parts that displays have in common: colours, flat heads with a screen, feet.

Lengths are in metres.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from data_prep.shapes.fronts import frame, panel
from data_prep.shapes.palettes import DISPLAY_CASES, DISPLAY_SCREENS, shade, shade_of
from data_prep.shapes.random_choices import chance, pick, uniform
from data_prep.shapes.solids import (
    Color,
    Part,
    box,
    curved_panel,
    lathe,
    moved,
    polygon,
    rectangle,
    rounded,
    slab,
    tube,
)


@dataclass(frozen=True)
class Look:
    """The colours of a display: its case, the border of its screen, the screen, the stand."""

    case: Color
    border: Color
    screen: Color
    stand: Color


def draw_look(rng: np.random.Generator, cases: dict[str, float], screens: dict[str, float]) -> Look:
    """Return colours by the chances of the materials; the border is the case's colour, or black."""
    case = shade_of(rng, cases, DISPLAY_CASES)
    black = shade(rng, DISPLAY_CASES["black"])
    return Look(
        case=case,
        border=case if chance(rng, 0.6) else black,
        screen=shade_of(rng, screens, DISPLAY_SCREENS),
        stand=case if chance(rng, 0.7) else shade_of(rng, {"black": 1, "silver": 1}, DISPLAY_CASES),
    )


@dataclass(frozen=True)
class Head:
    """A flat head, centred at the origin. Lengths in metres.

    border, chin   width of the frame around the screen, and how much wider it is below
    corner         radius of the corners, more than 0
    bulge          how far the electronics stand out behind, of `bulge_share` of width and height
    """

    width: float
    height: float
    thickness: float
    border: float
    chin: float
    corner: float
    bulge: float
    bulge_share: float

    @property
    def step(self) -> float:
        """Return the step in which parts stand out, a hundredth of the head's radius."""
        return 0.005 * math.hypot(self.width, self.height)


def flat_head(head: Head, look: Look) -> list[Part]:
    """Return a case with a frame in front of it, and the screen let in."""
    width, height, step = head.width, head.height, head.step
    front = -head.thickness / 2
    bevel = min(0.3 * head.thickness, 0.4 * head.corner)
    parts = [
        panel(
            (0, 0, 0), (width, height, head.thickness), look.case, corner=head.corner, bevel=bevel
        )
    ]
    # The frame is narrower than the case by a hair: their sides would share a plane.
    hair = 0.2 * step + bevel
    window = (width - 2 * hair, height - head.chin - 2 * hair)
    y = head.chin / 2
    parts.append(
        frame(
            (0, y, front - 0.6 * step), (*window, 2.8 * step), head.border, look.border,
            corner=0.9 * head.corner,
        )
    )  # fmt: skip
    inside = (window[0] - 1.2 * head.border, window[1] - 1.2 * head.border)
    parts.append(panel((0, y, front), (*inside, 2 * step), look.screen))
    if head.chin > 0.0:
        size = (window[0] - 0.4 * step, head.chin + head.border / 2, 2.2 * step)
        centre = (0, hair + (head.chin + head.border / 2 - height) / 2, front - 0.5 * step)
        parts.append(panel(centre, size, look.case))
    if head.bulge > 0.0:
        share = head.bulge_share
        parts.append(_bulge(head, share * width, share * height, look.case))
    return parts


def _bulge(head: Head, width: float, height: float, color: Color) -> Part:
    """Return the electronics: from the middle of the case to `head.bulge` behind it."""
    depth = head.thickness / 2 + head.bulge
    centre = (0, 0, depth / 2)
    return panel(centre, (width, height, depth), color, bevel=0.45 * min(head.bulge, depth))


def curved_head(head: Head, look: Look, half_angle_rad: float) -> list[Part]:
    """Return a head bent around the viewer, without a frame."""
    half, step = head.width / 2, head.step
    low, high = -head.height / 2, head.height / 2
    case = curved_panel(half, half_angle_rad, head.thickness, low, high, look.case)
    # Concentric with the case: its middle one layer nearer to the viewer.
    nearer = head.thickness / 2 + 0.2 * step
    radius = half / math.sin(half_angle_rad)
    angle = half_angle_rad - head.border / radius
    edge = head.border
    screen = curved_panel(
        (radius - nearer) * math.sin(angle), angle, 2.4 * step, low + edge, high - edge, look.screen
    )
    parts = [case, moved(screen, (0, 0, -nearer))]
    if head.bulge > 0.0:
        parts.append(_bulge(head, 0.3 * head.width, head.bulge_share * head.height, look.case))
    return parts


def foot(
    rng: np.random.Generator, width: float, depth: float, color: Color
) -> tuple[list[Part], float]:
    """Return the part that lies on the desk, and the height of its upper side."""
    kind = pick(rng, {"plate": 0.45, "round": 0.30, "vee": 0.25})
    if kind == "vee":
        thick = 0.08 * width
        hub = (0, thick, 0)
        tips = [(side * width / 2, 0.6 * thick, -0.8 * depth) for side in (-1, 1)]
        parts = [tube([hub, tip], 0.6 * thick, color) for tip in tips]
        parts.append(box(hub, (3 * thick, 1.6 * thick, 3 * thick), color))
        return parts, 1.5 * thick
    high = uniform(rng, (0.012, 0.028))
    if kind == "round":
        profile = [(width / 2, 0.0), (width / 2, 0.6 * high), (0.42 * width, high)]
        disc = lathe(profile, color, sides=24)
        points = disc.vertices * (1.0, 1.0, depth / width)
        return [Part(points, disc.faces, color)], high
    outline = rounded(rectangle(1, 1), uniform(rng, (0.05, 0.3)), steps=3)
    return [slab(outline, (0, high / 2, 0), (width, high, depth), color, bevel=0.3 * high)], high


def column(
    foot_head: tuple[float, float],
    z: float,
    size: tuple[float, float],
    color: Color,
    *,
    is_round: bool = False,
) -> Part:
    """Return the neck between the heights of foot and head, at depth z.

    `size` is that of its section (x, z).
    """
    outline = polygon(10, 0.5) if is_round else rectangle(1.0, 1.0)
    low, high = foot_head
    return slab(outline, (0, (low + high) / 2, z), (size[0], high - low, size[1]), color)
