"""Colours of real objects, by material and of single classes.

The background is white, so nothing is lighter than LIGHTEST.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from data_prep.shapes.random_choices import pick
from data_prep.shapes.solids import Color

_Palette = Mapping[str, Sequence[Color]]

LIGHTEST = 230
MATERIALS: _Palette = {
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
    "laminate": ((206, 204, 198), (150, 152, 154), (92, 94, 98), (214, 178, 130)),
    "lacquer": (
        (222, 218, 208),
        (204, 202, 196),
        (128, 132, 134),
        (46, 48, 52),
        (74, 92, 108),
        (116, 132, 112),
        (132, 56, 46),
    ),
    "brass": ((176, 142, 82), (150, 118, 66)),
}
AIRPLANE: _Palette = {
    "white": ((224, 225, 228), (214, 216, 220), (222, 220, 212)),
    "grey": ((176, 180, 186), (150, 155, 162), (196, 199, 203)),
    "livery": (
        (30, 62, 128),
        (182, 36, 42),
        (24, 110, 160),
        (226, 120, 36),
        (34, 116, 78),
        (224, 184, 60),
        (60, 64, 74),
    ),
    "glass": ((34, 42, 54), (44, 50, 58)),
    "dark": ((36, 36, 39), (52, 54, 58)),
    "warbird": ((92, 98, 68), (176, 180, 184), (70, 84, 104), (196, 168, 60)),
    "stunt": ((190, 40, 36), (222, 178, 50), (96, 104, 70), (50, 84, 140)),
    "military": (
        (128, 134, 140),
        (104, 110, 116),
        (150, 156, 160),
        (96, 102, 74),
        (172, 150, 112),
        (78, 88, 98),
    ),
    "stealth": ((58, 61, 66), (76, 80, 86), (44, 46, 52)),
}
BENCH: _Palette = {"stone": ((206, 202, 194), (164, 160, 152), (122, 120, 116))}
CABINET: _Palette = {
    "stone": ((58, 58, 60), (120, 116, 110), (186, 182, 174), (214, 210, 202)),
    "glass": ((150, 178, 188), (122, 146, 158), (178, 200, 206)),
    "steel": ((150, 152, 150), (176, 172, 158), (96, 100, 104), (58, 60, 64)),
}
CAR: _Palette = {
    "leather": ((156, 108, 70), (196, 172, 138), (120, 34, 34), (64, 62, 62)),
    "glass": ((40, 50, 62), (32, 40, 52), (64, 80, 96)),
    "tyre": ((26, 26, 28), (34, 34, 35)),
    "hub": ((168, 172, 176), (140, 144, 149), (92, 95, 100)),
    "headlight": ((226, 222, 200), (208, 214, 220)),
    "taillight": ((176, 30, 30),),
}
CAR_PAINTS: _Palette = {
    "white": ((222, 223, 222), (214, 212, 204)),
    "silver": ((172, 176, 180), (150, 155, 160)),
    "dark": ((46, 48, 54), (72, 77, 84), (34, 44, 70)),
    "red": ((178, 34, 36), (138, 26, 34)),
    "blue": ((36, 76, 152), (74, 122, 178)),
    "green": ((38, 96, 70), (92, 116, 78)),
    "bright": ((226, 182, 40), (224, 112, 36), (122, 180, 60), (44, 160, 186)),
}
DISPLAY_CASES: _Palette = {
    "black": ((36, 36, 38), (26, 26, 28), (50, 50, 53)),
    "silver": ((176, 178, 182), (198, 200, 202), (140, 143, 148)),
    "white": ((222, 222, 218), (208, 206, 200)),
    "beige": ((206, 196, 174), (190, 182, 164), (176, 170, 158)),
    "grey": ((96, 98, 102), (122, 124, 128)),
    "enamel": ((150, 60, 44), (206, 196, 174), (60, 60, 64), (120, 150, 140)),
}
DISPLAY_SCREENS: _Palette = {
    "off": ((26, 28, 32), (38, 41, 47), (20, 22, 27)),
    "glare": ((74, 88, 102), (98, 114, 128), (58, 70, 80)),
    "lit": ((66, 118, 178), (120, 172, 200), (170, 206, 212), (88, 140, 96), (42, 74, 126)),
    "tube": ((58, 66, 62), (74, 84, 80), (48, 52, 56), (96, 106, 104)),
}
LAMP: _Palette = {
    "linen": ((226, 216, 192), (214, 198, 160), (228, 224, 214), (196, 180, 148)),
    "dyed": ((150, 44, 40), (58, 84, 70), (52, 66, 104), (190, 110, 50), (40, 38, 40)),
    "milk-glass": ((228, 226, 216), (226, 216, 182), (220, 222, 226)),
    "amber": ((214, 152, 66), (226, 178, 92)),
    "brass": ((176, 141, 72), (150, 115, 58), (196, 162, 96)),
    "ceramic": (
        (62, 98, 132),
        (216, 208, 190),
        (148, 62, 48),
        (74, 106, 84),
        (40, 42, 46),
        (178, 150, 110),
    ),
    "cast-iron": ((34, 62, 48), (46, 48, 50), (28, 28, 31), (92, 98, 100)),
    "galvanised": ((150, 156, 160), (128, 132, 136), (176, 180, 182)),
    **{name: MATERIALS[name] for name in ("wood", "dark-metal", "chrome", "paint", "plastic")},
}
LOUDSPEAKER: _Palette = {
    "wood": MATERIALS["wood"],
    "black": ((36, 36, 38), (48, 48, 50), (28, 28, 30), (60, 58, 58)),
    "gloss": ((220, 218, 214), (176, 178, 180), (120, 122, 126), (120, 36, 34), (52, 70, 104)),
    "rubber": ((24, 24, 26), (34, 34, 36)),
    "cloth": ((34, 34, 36), (50, 50, 54), (76, 74, 72), (60, 50, 44)),
    "fabric": (
        (64, 66, 70),
        (112, 114, 116),
        (44, 44, 48),
        (168, 166, 160),
        (86, 98, 112),
        (146, 62, 54),
    ),
}
LOUDSPEAKER_CONES: _Palette = {
    "paper": ((62, 60, 60), (84, 82, 80), (48, 48, 52)),
    "kevlar": ((206, 178, 78), (214, 170, 60)),
    "metal": ((176, 180, 186), (150, 154, 160)),
    "white": ((222, 220, 214),),
    "copper": ((178, 110, 70),),
}
RIFLE: _Palette = {
    "polymer": ((34, 34, 36), (52, 52, 54), (44, 46, 48)),
    "olive": ((78, 84, 56), (96, 98, 70), (64, 74, 54)),
    "tan": ((176, 150, 108), (150, 128, 94)),
    "gunmetal": (*MATERIALS["dark-metal"], (74, 76, 80), (92, 95, 99)),
    "steel": ((146, 150, 154), (122, 126, 130)),
    "walnut": ((108, 66, 38), (134, 84, 46), (84, 52, 34), (156, 104, 58)),
}
TABLE: _Palette = {
    **{name: MATERIALS[name] for name in ("wood", "paint")},
    "glass": ((172, 200, 202), (146, 176, 184), (190, 206, 204)),
    "stone": ((208, 202, 192), (128, 126, 122), (66, 66, 70)),
}
TELEPHONE: _Palette = {
    "black": ((34, 34, 37), (24, 24, 27), (50, 51, 55)),
    "silver": ((180, 184, 190), (152, 156, 162), (202, 204, 208)),
    "white": ((224, 224, 222), (214, 212, 206)),
    "beige": ((206, 196, 172), (186, 174, 150)),
    "coloured": (
        (164, 40, 48),
        (44, 84, 150),
        (206, 104, 148),
        (74, 140, 104),
        (216, 180, 60),
        (96, 60, 120),
    ),
    "bakelite": ((28, 26, 26), (58, 38, 30), (146, 34, 32), (34, 62, 52), (206, 192, 162)),
    "glass": ((26, 28, 34), (40, 46, 58), (60, 72, 92)),
    "lit": ((112, 148, 186), (150, 176, 200), (86, 112, 156), (140, 164, 124)),
    "wood": MATERIALS["wood"],
}
VESSEL: _Palette = {
    "rubber": ((196, 54, 46), (214, 108, 46), (96, 100, 106)),
    "ship-hull": ((42, 44, 50), (40, 70, 124), (130, 44, 40), (44, 88, 74)),
    "deck": ((120, 70, 56), (96, 110, 92), (120, 122, 122)),
    "container": ((176, 64, 44), (48, 96, 148), (190, 140, 58), (60, 118, 84), (160, 162, 164)),
    "funnel": ((196, 60, 44), (40, 78, 138), (224, 170, 60), (40, 42, 46)),
    "sailcloth": ((222, 225, 228), (226, 224, 216), (214, 202, 174)),
    "white": ((222, 223, 224), (216, 214, 206)),
    "antifouling": ((128, 44, 38), (110, 36, 34), (44, 60, 92)),
    "red-antifouling": ((128, 44, 38), (110, 36, 34)),
    "teak": ((182, 140, 92), (160, 116, 72)),
    "trim": ((28, 56, 112), (170, 36, 36), (30, 30, 34), (36, 110, 120)),
    "glass": ((34, 44, 56), (46, 56, 66)),
    "black": ((34, 35, 38), (48, 50, 54)),
    "navy-grey": ((128, 134, 140), (106, 113, 120), (152, 157, 162)),
}


def shade(rng: np.random.Generator, material: str | Sequence[Color]) -> Color:
    """Return one of the colours of a material, changed a little at random.

    The material is a key of MATERIALS, or the colours themselves.

    The colour becomes up to 10 % lighter or darker, and then each channel changes by up to 6. All
    channels stay within 12..LIGHTEST.
    """
    choices = MATERIALS[material] if isinstance(material, str) else material
    base = np.array(choices[int(rng.integers(len(choices)))], dtype=np.float64)
    jittered = base * rng.uniform(0.9, 1.1) + rng.uniform(-6, 6, size=3)
    red, green, blue = np.clip(np.rint(jittered), 12, LIGHTEST).astype(int).tolist()
    return red, green, blue


def shades(rng: np.random.Generator, palette: _Palette, *names: str) -> list[Color]:
    """Return a colour of each named entry of a palette, changed a little as by `shade`."""
    return [shade(rng, palette[name]) for name in names]


def shade_of(
    rng: np.random.Generator, weights: Mapping[str, float], palette: _Palette = MATERIALS
) -> Color:
    """Return a colour of an entry of a palette, chosen by weight, changed a little as by `shade`.

    weights  probabilities of the entries, up to a factor
    """
    return shade(rng, palette[pick(rng, weights)])
