"""The thirteen procedural classes, a row each: one object of every structural family.

`python -m benchmarks.class_sheet OUT.png [--meshes FOLDER]` draws them from azimuth 30, elevation
20 degrees; with a folder of meshes, whose sub-folders are classes, up to three of each class follow
at the right end of its row.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from data_prep.datasets import open_dataset
from data_prep.images import blank
from data_prep.randomness import generator
from data_prep.render import render
from data_prep.scene import Mesh, View
from data_prep.shapes.catalogue import CLASSES
from data_prep.shapes.shape_class import ShapeClass

VIEW = View(azimuth_deg=30.0, elevation_deg=20.0)
FAMILIES = 8  # the most that a class has
REAL = 3
MOST_DRAWS = 1000


def sheet(meshes: str | None) -> NDArray[np.uint8]:
    """The picture [13 * IMAGE_SIZE, columns * IMAGE_SIZE, 3]."""
    rows = []
    for name, shape_class in CLASSES.items():
        row = _padded([_picture(mesh) for mesh in one_of_each_family(shape_class)], FAMILIES)
        if meshes is not None:
            row = np.concatenate([row, _padded(_real(meshes, name), REAL)])
        rows.append(np.concatenate(list(row), axis=1))
    return np.concatenate(rows)


def one_of_each_family(shape_class: ShapeClass) -> list[Mesh]:
    """The first validation object of each family, in the order of the families."""
    found: dict[str, Mesh] = {}
    for i in range(MOST_DRAWS):
        drawn = shape_class.draw(generator("procedural", shape_class.name, "validation", i))
        found.setdefault(drawn.family, drawn.mesh())
        if len(found) == len(shape_class.families):
            break
    return [found[family] for family in shape_class.families if family in found]


def _real(meshes: str, name: str) -> list[NDArray[np.uint8]]:
    objects = open_dataset(f"folder:{meshes}").objects(name, REAL, REAL)
    return [_picture(obj.load()) for obj in objects]


def _picture(mesh: Mesh) -> NDArray[np.uint8]:
    return render(mesh, [VIEW])[0]


def _padded(pictures: list[NDArray[np.uint8]], count: int) -> NDArray[np.uint8]:
    filled = blank(count)
    filled[: len(pictures)] = np.stack(pictures)
    return filled


def main() -> None:
    """Write the sheet from the command line."""
    parser = argparse.ArgumentParser(description="A sheet of the procedural classes.")
    parser.add_argument("out", type=Path)
    parser.add_argument("--meshes", help="a folder with real meshes, a sub-folder per class")
    options = parser.parse_args()
    picture = Image.fromarray(sheet(options.meshes))
    picture.quantize(256, dither=Image.Dither.NONE).save(options.out, optimize=True)
    print(options.out)


if __name__ == "__main__":
    main()
