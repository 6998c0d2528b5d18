"""How the report tells methods apart: who competes, and the style of each in plots."""

from __future__ import annotations

from collections.abc import Iterable

from bench.catalogue.methods import YARDSTICKS, role
from bench.catalogue.parameters import find_setting
from bench.report.page import Style

# Told apart by form too: a method is never known by its hue alone.
MARKERS = (
    "M-4 0a4 4 0 1 0 8 0a4 4 0 1 0-8 0z",  # disc
    "M-3.6-3.6h7.2v7.2h-7.2z",  # square
    "M0-4.8L4.6 3.4H-4.6z",  # triangle
    "M0-5L5 0L0 5L-5 0z",  # diamond
    "M0 4.8L4.6-3.4H-4.6z",  # triangle, downwards
    "M-1.5-4.8h3v3.3h3.3v3h-3.3v3.3h-3v-3.3h-3.3v-3h3.3z",  # cross
    "M-4.8 0L-2.4-4.2H2.4L4.8 0L2.4 4.2H-2.4z",  # hexagon
    "M-4.6-4.6L0-1.6L4.6-4.6L1.6 0L4.6 4.6L0 1.6L-4.6 4.6L-1.6 0z",  # star of four
)
HUES = 8  # of the style sheet


def rivals(methods: Iterable[str]) -> list[str]:
    """The methods that one could choose."""
    return [method for method in methods if not role(method)]


def is_yardstick(method: str) -> bool:
    """Whether nobody would draw with it: it is there for its cost."""
    return any(yardstick.id == method for yardstick in YARDSTICKS)


def family(method: str) -> str:
    """The method whose knob this one turns; without a knob the method itself."""
    setting = find_setting(method)
    return method if setting is None else setting.knob.method


def styles(methods: Iterable[str]) -> dict[str, Style]:
    """How each method looks in plots: those of a family look alike, floors are lines.

    The first eight families differ in hue, marker and dashes at once; further ones in hue.
    """
    ids = sorted(methods, key=is_yardstick)
    families: list[str] = []
    floors = 0
    made = {}
    for method in ids:
        if role(method) == "floor":
            made[method] = Style(f"floor floor-{floors % 2}", "")
            floors += 1
            continue
        if family(method) not in families:
            families.append(family(method))
        number = families.index(family(method))
        form = number % len(MARKERS)
        hue = (number + number // len(MARKERS)) % HUES
        made[method] = Style(f"hue-{hue} dash-{form}", MARKERS[form])
    return made
