"""The image of README: a chair and a real bench, clean and noisy, drawn by three methods.

    python -m studies.readme_image --meshes FOLDER [-o docs/answer.png]

FOLDER holds real meshes in a sub-folder for each class (`bench run --dataset folder:FOLDER`). The
objects are the first procedural test chair and the first mesh of the class `bench`.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from bench.catalogue.methods import RECOMMENDED
from bench.running.work import load_renderer
from bench.tables.figure import image_grid, save
from data_prep.datasets.registry import open_dataset
from studies.images import draw_row, row_titles

METHODS = {"denoised-\nwrap": "denoised-wrap", "pc2pix": "pc2pix", "fused-net\n@grey": RECOMMENDED}
SIZE_IN = (8.3, 2.3)  # 830 px wide on GitHub
DPI = 200


def main() -> None:
    """Run the study from the command line."""
    parser = argparse.ArgumentParser(description="The image of README.")
    parser.add_argument("--meshes", required=True, help="a folder of real meshes by class")
    parser.add_argument("-o", "--out", type=Path, default=Path("docs/answer.png"))
    options = parser.parse_args()
    (chair,) = open_dataset("procedural").objects("chair", 1, 1)
    (bench,) = open_dataset(f"folder:{options.meshes}").objects("bench", 1, 1)
    renderers = [load_renderer(method, "cpu") for method in METHODS.values()]
    titles = row_titles(list(METHODS))
    shapes = {"chair": chair, "real bench": bench}
    rows = [(label, draw_row(shape, renderers)) for label, shape in shapes.items()]
    save(image_grid(titles, rows, SIZE_IN, "antialiased"), options.out, dpi=DPI)


if __name__ == "__main__":
    main()
