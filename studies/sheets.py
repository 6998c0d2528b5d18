"""The sheets of images of the documentation: the truth, clouds, and what methods draw of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from bench import draw_cloud
from bench.catalogue.chosen import BEST_CLASSICAL, CHOSEN
from bench.catalogue.lookup import find
from bench.judges import VIEWS_WEIGHTS
from bench.judges.views import load_views_network
from bench.report.figure import Image
from bench.report.sheets import image_sheet
from bench.running.work import load_renderer
from bench.suites.latent.chairs import choose_pairs, specified_chairs
from bench.suites.latent.codes import load_network, strips_figure, walk
from data_prep.clouds.conditions import CONDITIONS
from data_prep.datasets.objects import GreyObject, SceneObject
from data_prep.datasets.registry import open_dataset
from data_prep.randomness import generator
from data_prep.rendering.dots import draw_dots
from data_prep.scene import View
from studies.images import draw_all

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SMALL = 6.5  # points, of text
VIEW = View(azimuth_deg=30, elevation_deg=20)
METRIC = "lpips"  # by which the best classical method is the best
_CONDITION_TITLES = {"2048": "clean", "noise-0.10": "noise 10 %"}
_NETWORKS = ("fused-net@grey", "splat-net@grey")
ANSWER = (*_NETWORKS, BEST_CLASSICAL, "pc2pix")
REAL = (*_NETWORKS, "occupancy-net", BEST_CLASSICAL)
SCANNED = ("splat", "alpha-wrap", "surface-apss", "occupancy-net", "fused-net@grey", "pc2pix@all")


def draw_objects(
    meshes: Path, classes: Sequence[str], methods: Sequence[str], width_in: float
) -> Figure:
    """Draw the first real mesh of each class, clean and under noise, by each method."""
    real = open_dataset(f"folder:{meshes}")
    rows = [
        (f"{name}\n{title}", _row(GreyObject(real.objects(name, 1, 1)[0]), condition, methods))
        for name in classes
        for condition, title in _CONDITION_TITLES.items()
    ]
    titles = ["truth", "cloud", *methods]
    return image_sheet(titles, rows, width_in=width_in, fontsize=SMALL, interpolation="antialiased")


def _row(shape: SceneObject, condition: str, methods: Sequence[str]) -> Iterator[Image]:
    perturbation = find(condition, CONDITIONS, "condition").perturbation
    sampled = shape.cloud(generator("sheet", shape.object_id))
    cloud = perturbation.apply(sampled, generator("sheet", condition, shape.object_id))
    yield shape.truth([VIEW])[0]
    yield draw_dots(cloud.points, [VIEW])[0]
    for method in methods:
        known = CHOSEN.get(method)
        drawer = known.ranking[METRIC, condition][0] if known else method
        yield draw_all(load_renderer(drawer, "cpu"), [cloud], [[VIEW]])[0, 0]


def draw_scans(meshes: Path, methods: Sequence[str], width_in: float) -> Figure:
    """Draw each scan beside the real meshes from two sides, by each method."""
    rows = [
        (
            f"{path.parent.name}\n{azimuth_deg}°",
            [draw_cloud(path, azimuth_deg, method=method) for method in methods],
        )
        for path in sorted((meshes / "pointclouds").rglob("*.ply"))
        for azimuth_deg in (30, -150)
    ]
    return image_sheet(methods, rows, width_in=width_in, fontsize=SMALL)


def draw_path(method: str, positions: int, width_in: float) -> Figure:
    """Draw what a network of codes makes of the path between two test chairs."""
    (pair,) = choose_pairs(specified_chairs("test", 2), generator(0, "latent pairs"))
    classifier = load_views_network(VIEWS_WEIGHTS)
    _, strip = walk(load_network(method, "cpu", VIEW), classifier, pair, 0, positions)
    return strips_figure([strip], VIEW, width_in=width_in, fontsize=SMALL)
