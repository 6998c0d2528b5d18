"""Colours of real objects, by material.

The background is white, so nothing is lighter than LIGHTEST.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from data_prep.shapes.solids import Color

LIGHTEST = 230
MATERIALS: dict[str, tuple[Color, ...]] = {
    "wood": (
        (214, 178, 130),
        (193, 154, 107),
        (164, 114, 66),
        (139, 94, 52),
        (108, 70, 40),
        (76, 50, 34),
    ),
    "paint": ((222, 218, 206), (96, 116, 98), (62, 76, 94), (164, 60, 48), (44, 44, 46)),
    "dark-metal": ((38, 38, 42), (58, 60, 64), (28, 28, 31)),
    "chrome": ((178, 182, 187), (152, 157, 162), (198, 201, 204)),
    "office-fabric": ((40, 42, 48), (44, 70, 122), (108, 111, 116), (146, 40, 44), (62, 64, 70)),
    "leather": ((38, 33, 31), (94, 60, 40), (154, 106, 68), (202, 178, 144), (222, 218, 210)),
    "upholstery": (
        (122, 116, 106),
        (172, 152, 126),
        (200, 190, 172),
        (78, 94, 114),
        (98, 112, 90),
        (142, 62, 56),
        (64, 66, 72),
        (168, 124, 62),
    ),
    "plastic": (
        (192, 50, 44),
        (220, 122, 48),
        (224, 184, 68),
        (66, 130, 92),
        (46, 102, 160),
        (222, 222, 218),
        (44, 44, 48),
    ),
}


def shade(rng: np.random.Generator, material: str | Sequence[Color]) -> Color:
    """One of the colours of a material (a key of MATERIALS, or the colours themselves), varied.

    Up to 10 % lighter or darker, each channel by up to 6 more; within 12..LIGHTEST.
    """
    choices = MATERIALS[material] if isinstance(material, str) else material
    base = np.array(choices[int(rng.integers(len(choices)))], dtype=np.float64)
    jittered = base * rng.uniform(0.9, 1.1) + rng.uniform(-6, 6, size=3)
    red, green, blue = np.clip(np.rint(jittered), 12, LIGHTEST).astype(int).tolist()
    return red, green, blue
