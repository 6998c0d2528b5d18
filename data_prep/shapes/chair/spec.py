"""The description of a procedural chair, and the tables it is drawn from.

Lengths are in metres, as furniture is measured; the finished shape is normalised.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from data_prep.shapes.palettes import shade, shade_of
from data_prep.shapes.random_choices import chance, pick, uniform
from data_prep.shapes.solids import Color

Family = Literal[
    "four-leg", "pedestal", "sled", "rocker", "cantilever", "armchair", "stool", "bar-stool"
]
Back = Literal["none", "solid", "slatted", "spindle", "ladder", "curved"]
_Seat = Literal["square", "rounded", "round", "trapezoid"]
_Base = Literal["legs", "star-5", "star-4", "disc"]
_Stretchers = Literal["none", "sides", "h", "box"]

BACKS: tuple[Back, ...] = get_args(Back)


@dataclass(frozen=True)
class ChairSpec:
    """The values that decide a chair's geometry and colours.

    Lengths are in metres. What a family has no use for is drawn all the same, so that every chair
    takes its values from the same places of the random stream.

    posts           the back is held clear of the seat by posts (a pedestal's: by a spine), instead
                    of growing out of it; an armchair's is as wide as its arms
    apron           rails under the seat, between the legs
    seat_height_m   floor to seat, without a cushion let into a frame
    back_height_m   along the leaning back, from the seat on
    gap_m           from the seat to the lower edge of a back on posts
    bend_rad        half of the arc of a curved back
    rear            width of a trapezoid seat at its rear over that at its front
    leg_m           thickness of legs, posts, tubes and columns
    leg_taper       thickness at the floor over thickness at the seat
    reach_m         radius of a star or disc base; other bases derive their overhang from it
    bars, bar_m     slats, spindles or rungs of an open back, and their thickness
    arm_height_m    above the seat
    """

    family: Family
    back: Back
    seat: _Seat
    base: _Base
    legs: int
    stretchers: _Stretchers
    round_legs: bool
    posts: bool
    cushion: bool
    apron: bool
    arms: bool
    seat_height_m: float
    seat_width_m: float
    seat_depth_m: float
    seat_thickness_m: float
    cushion_m: float
    back_height_m: float
    back_thickness_m: float
    rake_deg: float
    bend_rad: float
    gap_m: float
    rear: float
    leg_m: float
    leg_taper: float
    splay_deg: float
    reach_m: float
    bars: int
    bar_m: float
    arm_height_m: float
    arm_width_m: float
    frame_color: Color
    seat_color: Color
    back_color: Color


# How often each value is drawn. Rows need not add up to 1: they are weights.
FAMILY_WEIGHTS: dict[Family, float] = {
    "four-leg": 0.30,
    "pedestal": 0.16,
    "sled": 0.08,
    "rocker": 0.08,
    "cantilever": 0.08,
    "armchair": 0.14,
    "stool": 0.07,
    "bar-stool": 0.09,
}
_BACK_WEIGHTS: dict[Family, dict[Back, float]] = {
    "four-leg": {"solid": 0.25, "slatted": 0.22, "spindle": 0.17, "ladder": 0.20, "curved": 0.16},
    "pedestal": {"solid": 0.55, "curved": 0.45},
    "sled": {"solid": 0.45, "curved": 0.30, "ladder": 0.15, "slatted": 0.10},
    "rocker": {"spindle": 0.40, "slatted": 0.35, "ladder": 0.25},
    "cantilever": {"solid": 0.55, "curved": 0.30, "ladder": 0.15},
    "armchair": {"solid": 0.65, "curved": 0.35},
    "stool": {"none": 1.0},
    "bar-stool": {"none": 0.40, "solid": 0.20, "curved": 0.25, "ladder": 0.15},
}
_SEAT_WEIGHTS: dict[Family, dict[_Seat, float]] = {
    "four-leg": {"square": 0.35, "rounded": 0.25, "trapezoid": 0.30, "round": 0.10},
    "pedestal": {"square": 0.25, "rounded": 0.50, "round": 0.25},
    "sled": {"square": 0.50, "rounded": 0.50},
    "rocker": {"square": 0.35, "rounded": 0.30, "trapezoid": 0.35},
    "cantilever": {"square": 0.60, "rounded": 0.40},
    "armchair": {"square": 1.0},
    "stool": {"round": 0.50, "square": 0.30, "rounded": 0.20},
    "bar-stool": {"round": 0.45, "rounded": 0.30, "square": 0.25},
}
_BASE_WEIGHTS: dict[Family, dict[_Base, float]] = {
    "pedestal": {"star-5": 0.60, "star-4": 0.22, "disc": 0.18},
    "bar-stool": {"legs": 0.60, "disc": 0.40},
}
_STRETCHER_WEIGHTS: dict[Family, dict[_Stretchers, float]] = {
    "four-leg": {"none": 0.40, "sides": 0.15, "h": 0.25, "box": 0.20},
    "rocker": {"none": 0.20, "sides": 0.20, "h": 0.60},
    "stool": {"none": 0.40, "box": 0.60},
    "bar-stool": {"box": 1.0},
}
_ARM_CHANCE: dict[Family, float] = {
    "four-leg": 0.25,
    "pedestal": 0.45,
    "sled": 0.30,
    "rocker": 0.75,
}
_CUSHION_CHANCE: dict[Family, float] = {
    "four-leg": 0.30,
    "pedestal": 0.50,
    "sled": 0.40,
    "rocker": 0.20,
    "cantilever": 0.45,
    "armchair": 0.50,
    "stool": 0.30,
    "bar-stool": 0.45,
}
_APRON_CHANCE: dict[Family, float] = {"four-leg": 0.45, "stool": 0.35}
_POST_CHANCE: dict[Back, float] = {
    "solid": 0.55,
    "slatted": 0.75,
    "spindle": 0.35,
    "ladder": 1.0,
    "curved": 0.45,
}


@dataclass(frozen=True)
class Proportions:
    """The ranges of a family, in metres and degrees; each value is uniform within its range."""

    seat_height_m: tuple[float, float]
    seat_width_m: tuple[float, float]
    back_height_m: tuple[float, float]
    rake_deg: tuple[float, float]
    leg_m: tuple[float, float]
    splay_deg: tuple[float, float]


PROPORTIONS: dict[Family, Proportions] = {
    "four-leg": Proportions(
        (0.40, 0.50), (0.38, 0.52), (0.36, 0.60), (3, 14), (0.024, 0.050), (0, 9)
    ),
    "pedestal": Proportions(
        (0.40, 0.54), (0.42, 0.56), (0.36, 0.72), (3, 15), (0.040, 0.060), (0, 0)
    ),
    "sled": Proportions((0.40, 0.48), (0.42, 0.54), (0.32, 0.50), (6, 18), (0.020, 0.030), (0, 0)),
    "rocker": Proportions(
        (0.36, 0.44), (0.44, 0.56), (0.55, 0.78), (12, 22), (0.026, 0.042), (0, 5)
    ),
    "cantilever": Proportions(
        (0.42, 0.48), (0.42, 0.54), (0.32, 0.52), (6, 16), (0.020, 0.032), (0, 0)
    ),
    "armchair": Proportions(
        (0.36, 0.46), (0.60, 0.88), (0.32, 0.60), (4, 14), (0.030, 0.055), (0, 12)
    ),
    "stool": Proportions((0.36, 0.56), (0.30, 0.46), (0.00, 0.00), (0, 0), (0.022, 0.042), (0, 14)),
    "bar-stool": Proportions(
        (0.62, 0.80), (0.32, 0.44), (0.16, 0.36), (2, 10), (0.022, 0.036), (1, 8)
    ),
}

_FRAME_WEIGHTS: dict[Family, dict[str, float]] = {
    "four-leg": {"wood": 0.75, "paint": 0.17, "dark-metal": 0.08},
    "pedestal": {"dark-metal": 0.75, "chrome": 0.25},
    "sled": {"chrome": 0.75, "dark-metal": 0.25},
    "rocker": {"wood": 0.88, "paint": 0.12},
    "cantilever": {"chrome": 0.85, "dark-metal": 0.15},
    "armchair": {"wood": 0.70, "dark-metal": 0.20, "chrome": 0.10},
    "stool": {"wood": 0.70, "paint": 0.15, "dark-metal": 0.15},
    "bar-stool": {"chrome": 0.45, "dark-metal": 0.35, "wood": 0.20},
}
# The seat's material; "frame" repeats the frame's colour. The second table holds where the seat is
# upholstered and the first one names hard materials.
_SEAT_COLOR_WEIGHTS: dict[Family, dict[str, float]] = {
    "four-leg": {"frame": 0.60, "upholstery": 0.20, "leather": 0.10, "wood": 0.10},
    "pedestal": {"office-fabric": 0.75, "leather": 0.25},
    "sled": {"leather": 0.55, "plastic": 0.25, "wood": 0.20},
    "rocker": {"frame": 0.85, "upholstery": 0.15},
    "cantilever": {"leather": 0.80, "wood": 0.20},
    "armchair": {"upholstery": 0.70, "leather": 0.30},
    "stool": {"frame": 0.60, "wood": 0.15, "plastic": 0.25},
    "bar-stool": {"plastic": 0.60, "leather": 0.40},
}
_CUSHION_COLOR_WEIGHTS: dict[Family, dict[str, float]] = {
    "four-leg": {"upholstery": 0.70, "leather": 0.30},
    "rocker": {"upholstery": 1.0},
    "sled": {"leather": 1.0},
    "cantilever": {"leather": 1.0},
    "stool": {"upholstery": 0.50, "leather": 0.50},
}
# How often the back has the seat's colour; otherwise it has the frame's.
_BACK_LIKE_SEAT: dict[Back, float] = {
    "none": 1.0,
    "solid": 0.80,
    "curved": 0.80,
    "slatted": 0.08,
    "spindle": 0.08,
    "ladder": 0.15,
}


def draw_chair_spec(rng: np.random.Generator) -> ChairSpec:
    """Return a chair at random: the family first, then what suits it."""
    return draw_spec_of(rng, pick(rng, FAMILY_WEIGHTS))


def draw_spec_of(rng: np.random.Generator, family: Family) -> ChairSpec:
    """Return a chair of this family at random."""
    back = pick(rng, _BACK_WEIGHTS[family])
    seat = pick(rng, _SEAT_WEIGHTS[family])
    base: _Base = pick(rng, _BASE_WEIGHTS[family]) if family in _BASE_WEIGHTS else "legs"
    stretchers: _Stretchers = (
        pick(rng, _STRETCHER_WEIGHTS[family]) if family in _STRETCHER_WEIGHTS else "none"
    )
    legs = 3 if family == "stool" and seat == "round" and chance(rng, 0.5) else 4
    cushion = chance(rng, _CUSHION_CHANCE[family])
    apron = chance(rng, _APRON_CHANCE.get(family, 0.0))
    posts = chance(rng, _POST_CHANCE.get(back, 0.0))
    arms = chance(rng, _ARM_CHANCE.get(family, 0.0)) and seat != "round"

    # A disc is cast or spun: a bar stool on one is never of wood.
    metal = _FRAME_WEIGHTS["pedestal"] if base == "disc" else _FRAME_WEIGHTS[family]
    frame_color = shade_of(rng, metal)
    if cushion and family in _CUSHION_COLOR_WEIGHTS:
        seat_material = pick(rng, _CUSHION_COLOR_WEIGHTS[family])
    else:
        seat_material = pick(rng, _SEAT_COLOR_WEIGHTS[family])
    seat_color = frame_color if seat_material == "frame" else shade(rng, seat_material)
    back_color = seat_color if chance(rng, _BACK_LIKE_SEAT[back]) else frame_color
    if family == "armchair":
        back_color = seat_color if chance(rng, 0.75) else shade(rng, "upholstery")

    sizes = PROPORTIONS[family]
    seat_width_m = uniform(rng, sizes.seat_width_m)
    back_height_m = uniform(rng, sizes.back_height_m)
    bars_by_back = {"slatted": (3, 6), "spindle": (5, 9), "ladder": (2, 5)}
    low, high = bars_by_back.get(back, (0, 0))
    return ChairSpec(
        family=family,
        back=back,
        seat=seat,
        base=base,
        legs=legs,
        stretchers=stretchers,
        round_legs=chance(rng, 0.5),
        posts=posts,
        cushion=cushion,
        apron=apron,
        arms=arms,
        seat_height_m=uniform(rng, sizes.seat_height_m),
        seat_width_m=seat_width_m,
        # A seat is about as deep as it is wide; free draws would make benches and tongues.
        seat_depth_m=seat_width_m * uniform(rng, (0.86, 1.08)),
        seat_thickness_m=uniform(rng, (0.022, 0.050)),
        cushion_m=uniform(rng, (0.035, 0.075)),
        back_height_m=back_height_m,
        back_thickness_m=uniform(rng, (0.018, 0.045)),
        rake_deg=uniform(rng, sizes.rake_deg),
        bend_rad=uniform(rng, (0.35, 1.25)),
        gap_m=uniform(rng, (0.06, 0.45 * back_height_m + 0.06)),
        rear=uniform(rng, (0.74, 0.92)),
        leg_m=uniform(rng, sizes.leg_m),
        leg_taper=uniform(rng, (0.55, 1.0)),
        splay_deg=uniform(rng, sizes.splay_deg),
        reach_m=uniform(rng, (0.26, 0.33)),
        bars=int(rng.integers(low, high + 1)),
        bar_m=uniform(rng, (0.014, 0.030)),
        arm_height_m=uniform(rng, (0.17, 0.25)),
        arm_width_m=uniform(rng, (0.035, 0.060)),
        frame_color=frame_color,
        seat_color=seat_color,
        back_color=back_color,
    )
