"""The styles of methods in figures: one hue and marker for a family in every plot."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from bench.catalogue.lookup import family_of
from bench.catalogue.methods import BUNDLED, find_setting, role

Dashes = str | tuple[int, tuple[float, ...]]  # a line style of matplotlib

# Colours of the page's style sheet for light screens; for dark ones it replaces each by another.
INK, PAPER, SOFT, RULE, SHADE = "#000000", "#ffffff", "#535b64", "#d9d6d0", "#f2f0ec"
# They differ in lightness, too: by at least 20 (CIE76) for each kind of colour blindness. On paper
# and shade they have a contrast of 3, enough for lines and markers; words are in ink.
HUES = ("#2578f5", "#d66920", "#2e8551", "#520066", "#4a3a00", "#e8208f", "#32545c", "#15181b")
# Methods differ in marker and dashes, too: none is identified by its hue alone.
_MARKERS = ("o", "s", "^", "D", "v", ">", "<", "X")
_DASHES: tuple[Dashes, ...] = (
    "-",
    (0, (5.5, 2.5)),
    (0, (2, 2)),
    (0, (6, 2, 1.2, 2)),
    (0, (9, 2.5)),
    (0, (4, 1.2, 1.2, 1.2, 1.2, 1.2)),
    (0, (0.8, 2.5)),
    (0, (3, 3.5)),
)
_FLOOR_DASHES: tuple[Dashes, ...] = ((0, (6, 3)), (0, (2, 2)))
# The families of most plots: these eight differ in hue, marker and dashes at once.
_COMMON_FAMILIES = (
    "surface-apss",
    "splat-net",
    "pc2pix",
    "splat",
    "best-classical",
    "alpha-wrap",
    "fused-net",
    "denoised-wrap",
)
# The next families, in an order in which the methods of a default run differ in hue. Rows that
# choose a method (`best-classical`) are listed too: a new family then does not change their style.
_FURTHER_FAMILIES = (
    "best-learned-3d",
    "poisson",
    "occupancy-net",
    "surface-fit",
    "surface-bpa",
    "splat-fill",
    "points2pix",
    "open3d-poisson",
    "upsampled-wrap",
)


@dataclass(frozen=True)
class MethodStyle:
    """The style of a method in figures.

    marker  of matplotlib; empty for a floor, which is drawn as a line
    """

    colour: str
    marker: str
    dashes: Dashes


def rivals(methods: Iterable[str]) -> list[str]:
    """Return the methods that compete: all but reference methods and rows that choose one."""
    return [method for method in methods if not role(method)]


def method_styles(methods: Iterable[str]) -> dict[str, MethodStyle]:
    """Return the style of each method, which for bundled ones does not depend on the others.

    A family has one hue; its variants differ in marker and dashes. A method
    with another value of a parameter looks like the method. Families of other packages get the next
    styles, in the order of `methods`. Floors are dashed lines.
    """
    ours = (*_COMMON_FAMILIES, *_FURTHER_FAMILIES)
    variants: dict[str, list[str]] = {family: [] for family in ours}
    for bundled in BUNDLED:
        variants.setdefault(bundled.family, []).append(bundled.id)
    floors = 0
    styles = {}
    for method in methods:
        if role(method) == "floor":
            styles[method] = MethodStyle(SOFT, "", _FLOOR_DASHES[floors % len(_FLOOR_DASHES)])
            floors += 1
            continue
        setting = find_setting(method)
        base = setting.parameter.method if setting else method
        of_family = variants.setdefault(family_of(base), [])
        if base not in of_family:
            of_family.append(base)
        number, variant = list(variants).index(family_of(base)), of_family.index(base)
        # A family beyond the eighth shares its marker with one of another hue and other dashes. Of
        # its hue are families with earlier markers; variants take the later ones.
        shifted = number + number // len(_MARKERS)
        styles[method] = MethodStyle(
            HUES[shifted % len(HUES)],
            _MARKERS[(number + variant) % len(_MARKERS)],
            _DASHES[(shifted + variant) % len(_DASHES)],
        )
    return styles
