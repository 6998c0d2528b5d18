"""The sheets of images of the documentation: the truth, clouds, and what methods draw of them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from bench import draw_cloud
from bench.catalogue.chosen import BEST_CLASSICAL, CHOSEN
from bench.catalogue.conditions import CONDITIONS
from bench.catalogue.lookup import find
from bench.draw.cloud import Drawing, Failed, draw_in_process
from bench.judges import VIEWS_WEIGHTS
from bench.judges.views import load_views_network
from bench.report.plots import Image
from bench.report.sheets import image_sheet
from bench.running.work import load_renderer
from bench.suites.latent.chairs import choose_pairs, specified_chairs
from bench.suites.latent.codes import load_network, strips_figure, walk
from data_prep.clouds.sampling import sample_surface
from data_prep.datasets.objects import GreyObject, SceneObject
from data_prep.datasets.registry import ProceduralObject, open_dataset
from data_prep.randomness import generator
from data_prep.rendering.dots import draw_dots
from data_prep.scene import CLOUD_SIZE, View
from studies.images import draw_all

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SMALL = 6.0  # size of the text, in points
VIEW = View(azimuth_deg=30, elevation_deg=20)  # of all images of real meshes
METRIC = "lpips"  # the metric by which `best-classical` is the best method
CLEAN_AND_NOISY = {"2048": "clean", "noise-0.10": "noise 10 %"}  # of the rows of an object
LOT = {"2048": "clean", "512": "sparse", "noise-0.10": "noisy"}  # of the objects drawn by lot
PER_CONDITION = 2  # objects drawn by lot for each condition
SCAN_VIEW_DEG = -60  # azimuth from which the coloured scan shows its front
# The methods of each sheet, in the order of its columns.
_NETWORKS = ("fused-net@grey", "splat-net@grey")
ANSWER = (*_NETWORKS, "occupancy-net", BEST_CLASSICAL, "pc2pix@all")
REAL = (*_NETWORKS, "occupancy-net", BEST_CLASSICAL)
COLOURED = ("splat", "splat-fill", "alpha-wrap", "fused-net@grey")
FURTHER = {
    "2048": "2,048",
    "32768": "32,768",
    "three-views": "3 sides",
    "one-side": "one side",
}
OF_FURTHER = ("splat", "alpha-wrap", "occupancy-net", "splat-net@grey", "fused-net@grey")
SCANNED = ("splat", "alpha-wrap", "surface-apss", "occupancy-net", "fused-net@grey", "pc2pix@all")


def draw_objects(
    meshes: Path,
    classes: Sequence[str],
    methods: Sequence[str],
    width_in: float,
    conditions: Mapping[str, str] = CLEAN_AND_NOISY,
) -> Figure:
    """Return a sheet of the first real mesh of each class at each condition, by each method.

    meshes      the folder of real meshes
    width_in    width of the sheet, in inches
    conditions  the conditions and their titles
    """
    real = open_dataset(f"folder:{meshes}")
    rows = []
    for name in classes:
        shape = GreyObject(real.objects(name, 1, 1)[0])
        for condition, title in conditions.items():
            rows.append((f"{name}\n{title}", _row(shape, condition, methods)))
    titles = ["truth", "cloud", *methods]
    return image_sheet(titles, rows, width_in=width_in, fontsize=SMALL, interpolation="antialiased")


def draw_answer(meshes: Path, scan: Path, methods: Sequence[str], width_in: float) -> Figure:
    """Return a sheet of real meshes drawn by lot, and of a scan in its colours, by each method.

    meshes    the folder of real meshes
    scan      a file of points with colours whose up is +Z
    width_in  width of the sheet, in inches
    """
    real = open_dataset(f"folder:{meshes}")
    objects = [obj for name in real.classes for obj in real.objects(name, None, 1)]
    conditions = [condition for condition in LOT for _ in range(PER_CONDITION)]
    lot = generator("answer").choice(len(objects), len(conditions), replace=False)
    rows: list[tuple[str, Iterable[Image | str]]] = []
    for number, condition in zip(lot, conditions, strict=True):
        shape = objects[number]
        images = _row(GreyObject(shape), condition, methods)
        rows.append((f"{shape.class_name}\n{LOT[condition]}", images))
    of_scan: list[Image | str] = ["no truth"]
    for method in ("splat", *methods):
        drawing = _best(method, "2048")
        of_scan.append(draw_cloud(scan, SCAN_VIEW_DEG, method=drawing, up="z"))
    rows.append(("coloured\nscan", of_scan))
    titles = ["truth", "cloud", *methods]
    # Seven columns leave the name of a method less room than those of other sheets.
    return image_sheet(
        titles, rows, width_in=width_in, fontsize=SMALL - 0.5, interpolation="antialiased"
    )


def _row(shape: SceneObject, condition: str, methods: Sequence[str]) -> Iterator[Image]:
    """Yield the true image of an object, its cloud, and the images of methods."""
    perturbation = find(condition, CONDITIONS, "condition").perturbation
    sampled = shape.cloud(generator("sheet", shape.object_id))
    cloud = perturbation.apply(sampled, generator("sheet", condition, shape.object_id))
    yield shape.truth([VIEW])[0]
    yield draw_dots(cloud.points, [VIEW])[0]
    for method in methods:
        yield draw_all(load_renderer(_best(method, condition), "cpu"), [cloud], [[VIEW]])[0, 0]


def _best(method: str, condition: str) -> str:
    """Return the method that draws: `best-classical` stands for the first of a ranking."""
    chosen = CHOSEN.get(method)
    return chosen.ranking[METRIC, condition][0] if chosen else method


def draw_coloured(class_name: str, number: int, methods: Sequence[str], width_in: float) -> Figure:
    """Return a sheet of a validation object, its points, and these drawn in its colours.

    number    of the object in its class, from 0
    width_in  width of the sheet, in inches
    """
    shape = ProceduralObject(class_name, "validation", number)
    cloud = sample_surface(shape.load(), generator("sheet", shape.object_id), coloured=True)
    images: list[Image | str] = [shape.truth([VIEW])[0], draw_dots(cloud.points, [VIEW])[0]]
    for method in methods:
        drawn = draw_in_process(cloud, Drawing(method, (VIEW,), device="cpu"))
        images.append(drawn.reason if isinstance(drawn, Failed) else drawn[0])
    return image_sheet(
        ["truth", "points", *methods],
        [(class_name, images)],
        note=f"{CLOUD_SIZE:,} points",
        width_in=width_in,
        fontsize=SMALL,
        interpolation="antialiased",
    )


def draw_scans(meshes: Path, methods: Sequence[str], width_in: float) -> Figure:
    """Return a sheet of all scans from two sides, by each method.

    meshes    the folder of real meshes, whose folder "pointclouds" has the scans
    width_in  width of the sheet, in inches
    """
    rows = []
    for path in sorted((meshes / "pointclouds").rglob("*.ply")):
        for azimuth_deg in (30, -150):
            images = [draw_cloud(path, azimuth_deg, method=method) for method in methods]
            rows.append((f"{path.parent.name}\n{azimuth_deg}°", images))
    return image_sheet(methods, rows, width_in=width_in, fontsize=SMALL)


def draw_path(method: str, positions: int, width_in: float) -> Figure:
    """Return a strip of images of a network along the path between the codes of two test chairs.

    method     a network that makes codes, "pc2pix" for example
    positions  number of codes on the path
    width_in   width of the strip, in inches
    """
    (pair,) = choose_pairs(specified_chairs("test", 2), generator(0, "latent pairs"))
    classifier = load_views_network(VIEWS_WEIGHTS)
    _, strip = walk(load_network(method, "cpu", VIEW), classifier, pair, 0, positions)
    return strips_figure([strip], VIEW, width_in=width_in, fontsize=SMALL)
