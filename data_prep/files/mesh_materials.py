"""Libraries of materials (MTL), to which OBJ files refer."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

# The options of a texture, which stand before its name, and the most values of each.
_OPTIONS = {
    "-blendu": 1, "-blendv": 1, "-bm": 1, "-boost": 1, "-cc": 1, "-clamp": 1, "-imfchan": 1,
    "-mm": 2, "-o": 3, "-s": 3, "-t": 3, "-texres": 1, "-type": 1, "-colorspace": 1,
}  # fmt: skip
_OF_NUMBERS = ("-o", "-s", "-t", "-mm")  # these may have fewer values than the most
_COMMENT = re.compile(r"\s#.*")  # behind a value: a # in a name is a part of it
_ROUNDING = 1e-3  # how far beyond 0 to 1 a colour may be by the rounding of its writer
_WORD = re.compile(r'"[^"]*"|\S+')  # a name in quotes may have spaces
_NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")


@dataclass
class Material:
    """A material of a library, as far as it decides colours.

    diffuse  red, green and blue as bytes (Kd); None where the library has none that can be read
    problem  what is wrong with the diffuse colour, as the rest of a note; "" for nothing
    texture  the name of the picture of its colours (map_Kd) as the library has it; "" for none
    scale    the scale of places in the picture (-s), to the right and upwards
    shift    what is added to them afterwards (-o)
    """

    diffuse: tuple[int, int, int] | None = None
    problem: str = ""
    texture: str = ""
    scale: tuple[float, float] = (1.0, 1.0)
    shift: tuple[float, float] = (0.0, 0.0)


def library_names(text: str, find: Callable[[str], object]) -> list[str]:
    """Return the names of libraries in the words after `mtllib`.

    A name may have spaces, and a line may have several names: the whole of it counts as one name
    where `find` knows a file of that name, and where none of its words ends with .mtl but the last.
    """
    text = text.strip()
    if find(text):
        return [text]
    words = [match[0].strip('"') for match in _WORD.finditer(text)]
    libraries = [word for word in words if word.lower().endswith(".mtl")]
    return words if '"' in text or len(libraries) > 1 else [text]


def read_materials(data: bytes) -> dict[str, Material]:
    """Return the materials of a library by name. What cannot be read in it is passed over."""
    materials: dict[str, Material] = {}
    material = Material()  # takes what stands before the first name
    for line in decoded(data).replace("\\\n", " ").split("\n"):
        keyword, _, rest = line.strip().replace("\t", " ").partition(" ")
        rest = rest.strip()
        match keyword.lower():
            case "newmtl":
                material = materials.setdefault(rest, Material())
            case "kd":
                _set_diffuse(material, _COMMENT.sub("", rest).split())
            case "map_kd":
                _set_texture(material, _COMMENT.sub("", rest).strip())
    return materials


def decoded(data: bytes) -> str:
    """Return a text of UTF-8, 16 or 32, or else of Latin-1, with LF at the ends of its lines."""
    try:
        text = data.decode(json.detect_encoding(data[:4]))
    except UnicodeDecodeError:  # names in other encodings are then wrong, but differ as they should
        text = data.decode("latin-1")
    return text.removeprefix("\ufeff").replace("\r\n", "\n").replace("\r", "\n")


def _set_diffuse(material: Material, fields: list[str]) -> None:
    """Give a material its diffuse colour: three numbers of 0 to 1, or one that stands for all."""
    numbers = [float(field) for field in fields if _NUMBER.fullmatch(field)]
    if len(numbers) != len(fields) or len(numbers) not in (1, 3):
        material.problem = "has a colour that cannot be read"
        return
    material.problem = ""
    if not all(-_ROUNDING <= number <= 1 + _ROUNDING for number in numbers):
        material.problem = "has a colour beyond 0 to 1, which is cut"
    cut = np.clip(numbers * 3 if len(numbers) == 1 else numbers, 0.0, 1.0)
    red, green, blue = np.floor(255 * cut + 0.5).astype(int).tolist()
    material.diffuse = red, green, blue


def _set_texture(material: Material, text: str) -> None:
    """Give a material its texture: options, and then a name, which may have spaces."""
    while (option := text.partition(" ")[0].lower()) in _OPTIONS:
        text = text.partition(" ")[2].lstrip()
        values: list[str] = []
        while len(values) < _OPTIONS[option]:
            value, _, rest = text.partition(" ")
            if option in _OF_NUMBERS and not _NUMBER.fullmatch(value):
                break
            values.append(value)
            text = rest.lstrip()
        numbers = [float(value) for value in values if _NUMBER.fullmatch(value)]
        if option == "-s" and numbers:
            material.scale = (numbers[0], numbers[1] if len(numbers) > 1 else 1.0)
        if option == "-o" and numbers:
            material.shift = (numbers[0], numbers[1] if len(numbers) > 1 else 0.0)
    material.texture = text.strip("\"' ")
