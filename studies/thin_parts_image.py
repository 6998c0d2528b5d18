"""The image of thin parts in the documentation: two chairs, clean and noisy, by three methods.

    python -m studies.thin_parts_image [-o docs/thin-parts.png]

Of the first eight procedural test chairs those two with the most thin parts in the view.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from bench.catalogue.lookup import find
from bench.metrics.silhouette import object_boxes
from bench.metrics.thin_parts import evaluated
from bench.report.image_sheets import THIN_OF, THIN_TINT
from bench.running.work import load_renderer
from bench.tables.figure import image_grid, save
from data_prep.clouds.conditions import CONDITIONS
from data_prep.datasets.objects import SceneObject
from data_prep.datasets.registry import open_dataset
from data_prep.randomness import generator
from studies.images import CONDITION_TITLES, VIEW, draw_all
from studies.readme_image import DPI

METHODS = ("denoised-alpha", "pc2pix", "splat-net@chair")
SHOWN = 2
MARGIN_PX = 3
SIZE_IN = (8.0, 2.7)


def draw_row(shape: SceneObject) -> Iterator[np.ndarray]:
    """Yield the true image, its thin parts, and what methods draw, cut out around the object."""
    (truth,) = shape.truth([VIEW])
    top, bottom, left, right = object_boxes(truth[None])[0].tolist()
    cut = (
        slice(max(top - MARGIN_PX, 0), bottom + MARGIN_PX),
        slice(max(left - MARGIN_PX, 0), right + MARGIN_PX),
    )
    yield truth[cut]
    tint = np.array(THIN_TINT, np.uint8)
    yield np.where(evaluated(truth[None])[0][..., None], tint, truth)[cut]
    sampled = shape.cloud(generator("thin parts", shape.object_id))
    for condition in CONDITION_TITLES:
        perturbation = find(condition, CONDITIONS, "condition").perturbation
        cloud = perturbation.apply(sampled, generator("thin parts", condition, shape.object_id))
        for method in METHODS:
            yield draw_all(load_renderer(method, "cpu"), [cloud], [[VIEW]])[0, 0][cut]


def main() -> None:
    """Run the study from the command line."""
    parser = argparse.ArgumentParser(description="The image of thin parts in the documentation.")
    parser.add_argument("-o", "--out", type=Path, default=Path("docs/thin-parts.png"))
    options = parser.parse_args()
    chairs = open_dataset("procedural").objects("chair", THIN_OF, 1)
    counts = [evaluated(np.asarray(chair.truth([VIEW]))).sum() for chair in chairs]
    chosen = np.argsort(counts)[::-1][:SHOWN]
    titles = ["truth", "its thin parts"]
    titles += [f"{method}\n{title}" for title in CONDITION_TITLES.values() for method in METHODS]
    rows = [("chair", draw_row(chairs[index])) for index in chosen]
    save(image_grid(titles, rows, SIZE_IN, "antialiased"), options.out, dpi=DPI)


if __name__ == "__main__":
    main()
