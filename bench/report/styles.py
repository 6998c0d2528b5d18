"""How the report distinguishes methods: who competes, and the look of each in figures."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from bench.catalogue.methods import COST_VARIANTS, role
from bench.catalogue.parameters import find_setting

Dashes = str | tuple[int, tuple[float, ...]]

# Colours of the page's style sheet in light; in dark it replaces them one by one.
INK, PAPER, SOFT, RULE = "#000000", "#ffffff", "#535b64", "#d9d6d0"
HUES = ("#0b5fa5", "#b4450a", "#00735a", "#8a3b8f", "#7a5b00", "#b3123b", "#0b6e85", "#57606a")
# Forms differ too: a method is never identified by its hue alone.
MARKERS = ("o", "s", "^", "D", "v", ">", "<", "X")
DASHES: tuple[Dashes, ...] = (
    *("-", (0, (5.5, 2.5)), (0, (2, 2)), (0, (6, 2, 1.2, 2)), (0, (9, 2.5))),
    *((0, (4, 1.2, 1.2, 1.2, 1.2, 1.2)), (0, (0.8, 2.5)), (0, (3, 3.5))),
)
FLOOR_DASHES: tuple[Dashes, ...] = ((0, (6, 3)), (0, (2, 2)))


@dataclass(frozen=True)
class Look:
    """How a method is drawn; `marker` is empty for a floor, which is only a line."""

    colour: str
    marker: str
    dashes: Dashes


def rivals(methods: Iterable[str]) -> list[str]:
    """The methods that one could choose."""
    return [method for method in methods if not role(method)]


def is_cost_variant(method: str) -> bool:
    """Whether nobody would draw with it: it is there for its cost."""
    return any(variant.id == method for variant in COST_VARIANTS)


def family(method: str) -> str:
    """The method whose parameter this one sets; without a parameter the method itself."""
    setting = find_setting(method)
    return method if setting is None else setting.parameter.method


def looks(methods: Iterable[str]) -> dict[str, Look]:
    """How each method is drawn: those of a family look alike, floors are dashed lines.

    The first eight families differ in hue, marker and dashes at once; further ones in hue. Variants
    of a method (`@`) come after the methods.
    """
    ids = sorted(methods, key=lambda method: (is_cost_variant(method), "@" in family(method)))
    families: list[str] = []
    floors = 0
    made = {}
    for method in ids:
        if role(method) == "floor":
            made[method] = Look(SOFT, "", FLOOR_DASHES[floors % len(FLOOR_DASHES)])
            floors += 1
            continue
        if family(method) not in families:
            families.append(family(method))
        number = families.index(family(method))
        form = number % len(MARKERS)
        hue = (number + number // len(MARKERS)) % len(HUES)
        made[method] = Look(HUES[hue], MARKERS[form], DASHES[form])
    return made
