"""Images of many objects at once, every metric of them, and views that are turned a little."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.catalogue.lookup import find
from bench.catalogue.metrics import CONTROL_METRICS, IMAGE_METRICS, column
from bench.judges import JUDGE_WEIGHTS, VIEWS_WEIGHTS
from bench.judges import answers as control
from bench.judges.judge import greyscale, judge, load_judge_network
from bench.judges.views import load_views_network, view_features
from bench.metrics import lpips
from bench.metrics.frechet import frechet_distance
from bench.metrics.image_scores import scores
from bench.metrics.kernel_distance import kernel_distance
from bench.metrics.lpips_network import Lpips
from bench.metrics.packaged_weights import find_lpips_weights
from data_prep.clouds.conditions import CONDITIONS
from data_prep.clouds.sampling import random_views, sample_surface
from data_prep.datasets.registry import ProceduralObject
from data_prep.randomness import generator
from data_prep.rendering.images import to_uint8
from data_prep.rendering.opengl import render
from data_prep.scene import Mesh, PointCloud, Renderer, UInt8Images, View

TURN_DEG = 0.1  # 0.1 px at the rim of the unit sphere: what another driver may amount to
DISTANCES = ("fd-views", "fd-views-grey", "fd-alexnet")
METRICS = (*IMAGE_METRICS, *DISTANCES, "kd-alexnet", *CONTROL_METRICS)


class SceneSet(NamedTuple):
    """Objects with a cloud and as many views each."""

    meshes: tuple[Mesh, ...]
    clouds: tuple[PointCloud, ...]
    views: tuple[tuple[View, ...], ...]


def make_scene(
    class_name: str, objects: int, views: int, seed: str | int, condition: str = "2048"
) -> SceneSet:
    """Return the first validation objects; `seed` chooses views, points and degradation.

    Raises BadInput for an unknown condition.
    """
    perturbation = find(condition, CONDITIONS, "condition").perturbation
    every = range(objects)
    meshes = tuple(ProceduralObject(class_name, "validation", i).load() for i in every)
    clouds = (
        sample_surface(mesh, generator("noise floor", "cloud", seed, i))
        for i, mesh in enumerate(meshes)
    )
    degraded = (
        perturbation.apply(cloud, generator("noise floor", condition, seed, i))
        for i, cloud in enumerate(clouds)
    )
    rngs = (generator("noise floor", "views", seed, i) for i in every)
    return SceneSet(meshes, tuple(degraded), tuple(random_views(views, rng) for rng in rngs))


def draw_all(
    renderer: Renderer, clouds: Sequence[PointCloud], views: Sequence[Sequence[View]]
) -> UInt8Images:
    """Return images of clouds, each from its views, by a method that draws no random numbers."""
    unused = np.random.default_rng(0)
    return np.stack(
        [
            to_uint8(renderer.draw(renderer.prepare(cloud, unused), of_cloud, unused))
            for cloud, of_cloud in zip(clouds, views, strict=True)
        ]
    )


def render_all(meshes: Sequence[Mesh], views: Sequence[Sequence[View]]) -> UInt8Images:
    """Return the true images of meshes, each from its views."""
    return np.stack([render(*pair) for pair in zip(meshes, views, strict=True)])


def turned(views: Sequence[View]) -> tuple[View, ...]:
    """Return the views with TURN_DEG more of azimuth."""
    return tuple(replace(view, azimuth_deg=view.azimuth_deg + TURN_DEG) for view in views)


class Outputs(NamedTuple):
    """The outputs of the feature networks for images: [objects, views, d] each."""

    colour: NDArray[np.floating]
    grey: NDArray[np.floating]
    alexnet: NDArray[np.floating]
    answers: NDArray[np.floating]


class FeatureNetworks:
    """The bundled networks, which turn images into features as in a run."""

    def __init__(self) -> None:
        self.views = load_views_network(VIEWS_WEIGHTS)
        self.judge = load_judge_network(JUDGE_WEIGHTS)
        self.alexnet = Lpips(find_lpips_weights())

    def __call__(self, images: UInt8Images) -> Outputs:
        """Return features of images [objects, views, H, W, 3]."""
        flat = images.reshape(-1, *images.shape[2:])
        grey = np.repeat(greyscale(flat)[..., None], 3, axis=-1)
        colours = (view_features(self.views, part) for part in (flat, grey))
        alexnet = self.alexnet.encode(flat).features.numpy()
        outputs = (*colours, alexnet, judge(self.judge, flat))
        return Outputs(*(values.reshape(*images.shape[:2], -1) for values in outputs))


def cells(
    truth: UInt8Images,
    truth_outputs: Outputs,
    drawn: UInt8Images,
    outputs: Outputs,
    views: Sequence[Sequence[View]],
) -> dict[str, float]:
    """Return every metric over all images of chairs, as the tables of a run take it.

    Means are over the images that have a value; there are distances, medians of the judge's errors,
    and the share of objects found.
    """
    scored = [all_scores(t, d) for t, d in zip(truth, drawn, strict=True)]
    values = {
        metric: finite_mean(np.concatenate([per_image[column(metric)] for per_image in scored]))
        for metric in IMAGE_METRICS
    }
    for metric, x, y in zip(DISTANCES, truth_outputs, outputs, strict=False):
        values[metric] = frechet_distance(_flat(x), _flat(y))
    values["kd-alexnet"] = kernel_distance(_flat(truth_outputs.alexnet), _flat(outputs.alexnet))
    answers = _flat(outputs.answers)
    azimuth = np.array([view.azimuth_deg for of_chair in views for view in of_chair])
    elevation = np.array([view.elevation_deg for of_chair in views for view in of_chair])
    images = [(f"{chair:04d}", view) for chair, view in np.ndindex(drawn.shape[:2])]
    among = control.gallery("chair", images, _flat(truth_outputs.answers))
    errors = control.azimuth_error_deg(answers, azimuth)
    values["azimuth-error-deg"] = float(np.median(errors))
    errors = control.elevation_error_deg(answers, elevation)
    values["elevation-error-deg"] = float(np.median(errors))
    values["retrieval"] = float(control.found(among, answers, images).mean())
    return values


def all_scores(truth: UInt8Images, drawn: UInt8Images) -> dict[str, NDArray[np.float64]]:
    """Return every image metric [V] of images [V, H, W, 3], named as the columns of a record."""
    return scores(truth, drawn) | {"lpips": lpips(truth, drawn, single=True)}


def finite_mean(values: NDArray[np.float64]) -> float:
    """Return the mean of the finite values; NaN where no value is finite."""
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if len(finite) else float("nan")


def _flat(features: NDArray[np.floating]) -> NDArray[np.floating]:
    return features.reshape(-1, features.shape[-1])
