"""A sheet of the shapes of an embedded dataset, each from one random view.

    python -m studies.shape_sheet procedural:widened -o widened.png [--class chair] [--split train]

Twelve in a row. Of widened shapes it also prints how many draws were rejected as folded, flat or
inside out before those that are shown (`data_prep.shapes.augmentation.draw_widened`).
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from PIL import Image

from data_prep.datasets.objects import SceneObject
from data_prep.datasets.procedural import WidenedObject
from data_prep.datasets.registry import open_dataset
from data_prep.randomness import generator
from data_prep.shapes.augmentation import draw_widened
from data_prep.shapes.catalogue import CLASSES
from studies.arguments import names, positive

COLUMNS = 12


def sheet(objects: list[SceneObject]) -> np.ndarray:
    """Return images of objects in rows, uint8; white where there are no more."""
    images = [o.truth(o.views(1, generator("sheet", o.object_id)))[0] for o in objects]
    images += [np.full_like(images[0], 255)] * (-len(images) % COLUMNS)
    rows = np.array(images).reshape(-1, COLUMNS, *images[0].shape)
    return rows.swapaxes(1, 2).reshape(len(rows) * images[0].shape[0], -1, 3)


def rejected(objects: list[SceneObject]) -> int:
    """Return how many draws were rejected before these; 0 for shapes that are not widened."""
    widened = [obj for obj in objects if isinstance(obj, WidenedObject)]
    return sum(draw_widened(CLASSES[o.class_name], o.random_numbers())[1] for o in widened)


def main() -> None:
    """Run the study from the command line."""
    parser = argparse.ArgumentParser(description="A sheet of shapes.")
    parser.add_argument("dataset")
    parser.add_argument("-o", "--out", type=Path, required=True)
    parser.add_argument("--class", dest="classes", type=names, help="default: all")
    parser.add_argument("--split", default=None, help="default: the one that is measured")
    parser.add_argument("--objects", type=positive, default=24, help="of each class")
    options = parser.parse_args()
    dataset = open_dataset(options.dataset)
    objects = [
        obj
        for name in options.classes or dataset.classes
        for obj in dataset.objects(name, options.objects, options.objects, options.split)
    ]
    Image.fromarray(sheet(objects)).save(options.out, optimize=True)
    print(f"{len(objects)} shapes, {rejected(objects)} draws rejected before them")


if __name__ == "__main__":
    main()
