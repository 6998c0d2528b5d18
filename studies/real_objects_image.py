"""A sheet of real objects, clean and noisy, by the methods for objects of any kind, truth in grey.

    python -m studies.real_objects_image --meshes FOLDER [-o docs/real-objects.png]

FOLDER holds real meshes in a sub-folder for each class (`bench run --dataset folder:FOLDER`). The
objects are the first meshes of ten of the 13 classes, in the order of the folder.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from bench.running.work import load_renderer
from bench.tables.figure import image_grid, save
from data_prep.datasets.grey import GreyObject
from data_prep.datasets.registry import open_dataset
from data_prep.shapes.catalogue import CLASSES
from studies.images import draw_row, row_titles

METHODS = ("denoised-wrap", "occupancy-net", "splat-net@grey", "fused-net@grey")
ROWS = 10
SIZE_IN = (8.3, 9.2)
DPI = 160


def main() -> None:
    """Run the study from the command line."""
    parser = argparse.ArgumentParser(description="A sheet of real objects.")
    parser.add_argument("--meshes", required=True, help="a folder of real meshes by class")
    parser.add_argument("-o", "--out", type=Path, default=Path("docs/real-objects.png"))
    options = parser.parse_args()
    dataset = open_dataset(f"folder:{options.meshes}")
    renderers = [load_renderer(method, "cpu") for method in METHODS]
    titles = row_titles([name.replace("-", "-\n") for name in METHODS])
    rows = []
    known = [class_name for class_name in dataset.classes if class_name in CLASSES]
    for class_name in known[:ROWS]:
        (shape,) = dataset.objects(class_name, 1, 1)
        rows.append((class_name, draw_row(GreyObject(shape), renderers)))
    save(image_grid(titles, rows, SIZE_IN, "antialiased"), options.out, dpi=DPI)


if __name__ == "__main__":
    main()
