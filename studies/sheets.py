"""The sheets of pictures in the documentation: the truth, clouds and what methods draw of them.

    python -m studies.sheets answer --meshes FOLDER [-o docs/answer.png]
    python -m studies.sheets real-objects --meshes FOLDER [-o docs/real-objects.png]
    python -m studies.sheets thin-parts [-o docs/thin-parts.png]

FOLDER holds real meshes in a sub-folder for each class (`bench run --dataset folder:FOLDER`).

answer        the image of README: the first procedural test chair and the first mesh of `bench`.
real-objects  the first meshes of ten of the 13 classes, in the order of the folder, truth in grey.
thin-parts    of the first eight procedural test chairs those two with the most thin parts in the
              view, cut out around the object.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from bench.catalogue.lookup import find
from bench.catalogue.methods import RECOMMENDED
from bench.metrics.thin_parts import evaluated
from bench.report.figure import save
from bench.report.sheets import THIN_OF, image_sheet, thin_cut
from bench.running.work import load_renderer
from data_prep.clouds.conditions import CONDITIONS
from data_prep.datasets.objects import GreyObject, SceneObject
from data_prep.datasets.registry import open_dataset
from data_prep.randomness import generator
from data_prep.rendering.dots import draw_dots
from data_prep.scene import PointCloud, Renderer, UInt8Images, View
from data_prep.shapes.catalogue import CLASSES
from studies.images import draw_all

_CONDITION_TITLES = {"2048": "2,048 points", "noise-0.10": "noise 10 %"}
VIEW = View(azimuth_deg=30, elevation_deg=20)

METHODS = {
    "answer": ("denoised-wrap", "pc2pix", RECOMMENDED),
    "real-objects": ("denoised-wrap", "occupancy-net", "splat-net@grey", "fused-net@grey"),
    "thin-parts": ("denoised-wrap", "pc2pix", "splat-net@chair"),
}
DPI = 220
ROWS, THIN_ROWS = 10, 2


def clouds(shape: SceneObject, of_sheet: str) -> Iterator[PointCloud]:
    """Yield the cloud of an object under each of _CONDITION_TITLES."""
    sampled = shape.cloud(generator(of_sheet, shape.object_id))
    for condition in _CONDITION_TITLES:
        perturbation = find(condition, CONDITIONS, "condition").perturbation
        yield perturbation.apply(sampled, generator(of_sheet, condition, shape.object_id))


def row(shape: SceneObject, renderers: Sequence[Renderer]) -> Iterator[UInt8Images]:
    """Yield the true image, then for each condition the cloud and what the methods draw of it."""
    yield shape.truth([VIEW])[0]
    for cloud in clouds(shape, "readme"):
        yield draw_dots(cloud.points, [VIEW])[0]
        for renderer in renderers:
            yield draw_all(renderer, [cloud], [[VIEW]])[0, 0]


def _thin_row(shape: SceneObject, renderers: Sequence[Renderer]) -> Iterator[UInt8Images]:
    """Yield the true image, its thin parts and what methods draw, cut out around the object."""
    (truth,) = shape.truth([VIEW])
    cut, tinted = thin_cut(truth, evaluated(truth[None])[0])
    yield from (truth[cut], tinted[cut])
    for cloud in clouds(shape, "thin parts"):
        for renderer in renderers:
            yield draw_all(renderer, [cloud], [[VIEW]])[0, 0][cut]


def objects(sheet: str, meshes: str | None) -> list[tuple[str, SceneObject]]:
    """Return the objects of a sheet, each with the name of its row."""
    procedural = open_dataset("procedural")
    if sheet == "thin-parts":
        chairs = procedural.objects("chair", THIN_OF, 1)
        counts = [evaluated(np.asarray(chair.truth([VIEW]))).sum() for chair in chairs]
        return [("chair", chairs[index]) for index in np.argsort(counts)[::-1][:THIN_ROWS]]
    real = open_dataset(f"folder:{meshes}")
    if sheet == "answer":
        (chair,), (bench,) = procedural.objects("chair", 1, 1), real.objects("bench", 1, 1)
        return [("chair", chair), ("real bench", bench)]
    known = [class_name for class_name in real.classes if class_name in CLASSES]
    return [(name, GreyObject(real.objects(name, 1, 1)[0])) for name in known[:ROWS]]


def main() -> None:
    """Draw a sheet from the command line."""
    parser = argparse.ArgumentParser(description="The sheets of pictures in the documentation.")
    parser.add_argument("sheet", choices=METHODS)
    parser.add_argument("--meshes", help="a folder of real meshes by class")
    parser.add_argument("-o", "--out", type=Path)
    options = parser.parse_args()
    sheet = options.sheet
    if sheet != "thin-parts" and not options.meshes:
        parser.error(f"{sheet}: give --meshes FOLDER")
    renderers = [load_renderer(method, "cpu") for method in METHODS[sheet]]
    if sheet == "thin-parts":
        draw, titles = _thin_row, ["truth", "its thin parts"]
        for title in _CONDITION_TITLES.values():
            titles += [f"{name}\n{title}" for name in METHODS[sheet]]
    else:
        draw, titles = row, ["truth"]
        for title in _CONDITION_TITLES.values():
            titles += [f"cloud,\n{title}", *(name.replace("-", "-\n") for name in METHODS[sheet])]
    rows = [(label, draw(shape, renderers)) for label, shape in objects(sheet, options.meshes)]
    out = options.out or Path("docs") / f"{sheet}.png"
    save(image_sheet(titles, rows, interpolation="antialiased"), out, dpi=DPI)


if __name__ == "__main__":
    main()
