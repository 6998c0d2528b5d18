"""The image of README: a chair and a real bench, clean and noisy, drawn by three methods.

    python -m studies.readme_image --meshes FOLDER [-o docs/answer.png]

FOLDER holds real meshes in a sub-folder for each class (`bench run --dataset folder:FOLDER`). The
objects are the first procedural test chair and the first mesh of the class `bench`.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from bench.catalogue.chosen import BEST_RECONSTRUCTION
from bench.catalogue.lookup import find
from bench.running.work import load_renderer
from bench.tables.figure import image_grid, save
from data_prep.clouds.conditions import CONDITIONS
from data_prep.datasets.objects import SceneObject
from data_prep.datasets.registry import open_dataset
from data_prep.randomness import generator
from data_prep.rendering.dots import draw_dots
from data_prep.scene import View
from studies.images import draw_all

# denoised-alpha was best on validation chairs at both conditions (docs/reconstruction.md)
METHODS = {
    BEST_RECONSTRUCTION: "denoised-alpha",
    "pc2pix": "pc2pix",
    "splat-net": "splat-net@grey",
}
CONDITION_TITLES = {"2048": "2,048 points", "noise-0.10": "noise 10 %"}
VIEW = View(azimuth_deg=30, elevation_deg=20)
SIZE_IN = (8.3, 2.3)  # 830 px wide on GitHub
DPI = 200


def draw_row(shape: SceneObject) -> Iterator[np.ndarray]:
    """Yield the true image of an object; for each condition the cloud and what methods draw."""
    yield shape.truth([VIEW])[0]
    sampled = shape.cloud(generator("readme", shape.object_id))
    for condition in CONDITION_TITLES:
        perturbation = find(condition, CONDITIONS, "condition").perturbation
        cloud = perturbation.apply(sampled, generator("readme", condition, shape.object_id))
        yield draw_dots(cloud.points, [VIEW])[0]
        for method in METHODS.values():
            yield draw_all(load_renderer(method, "cpu"), [cloud], [[VIEW]])[0, 0]


def main() -> None:
    """Run the study from the command line."""
    parser = argparse.ArgumentParser(description="The image of README.")
    parser.add_argument("--meshes", required=True, help="a folder of real meshes by class")
    parser.add_argument("-o", "--out", type=Path, default=Path("docs/answer.png"))
    options = parser.parse_args()
    (chair,) = open_dataset("procedural").objects("chair", 1, 1)
    (bench,) = open_dataset(f"folder:{options.meshes}").objects("bench", 1, 1)
    titles = ["truth"]
    for condition in CONDITION_TITLES.values():
        names = [name.replace("-", "\n", name == BEST_RECONSTRUCTION) for name in METHODS]
        titles += [f"cloud,\n{condition}", *names]
    rows = [(label, draw_row(shape)) for label, shape in (("chair", chair), ("real bench", bench))]
    save(image_grid(titles, rows, SIZE_IN, "antialiased"), options.out, dpi=DPI)


if __name__ == "__main__":
    main()
