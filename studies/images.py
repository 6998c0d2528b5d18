"""The parts that studies share: images of many objects at once, their metrics, turned views."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.catalogue.conditions import CONDITIONS
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
from data_prep.clouds.sampling import random_views, sample_surface
from data_prep.datasets.registry import ProceduralObject
from data_prep.randomness import generator
from data_prep.rendering.images import to_uint8
from data_prep.rendering.opengl import render
from data_prep.scene import Mesh, PointCloud, Renderer, UInt8Images, View

# Degrees by which views are turned. It moves the rim of the unit sphere by 0.1 pixels, about as
# much as another driver may move edges.
TURN_DEG = 0.1
DISTANCES = ("fd-views", "fd-views-grey", "fd-alexnet")  # of the first three fields of `Outputs`
METRICS = (*IMAGE_METRICS, *DISTANCES, "kd-alexnet", *CONTROL_METRICS)


class SceneSet(NamedTuple):
    """Objects with a cloud of each, and the same number of views of each."""

    meshes: tuple[Mesh, ...]
    clouds: tuple[PointCloud, ...]
    views: tuple[tuple[View, ...], ...]


def make_scene(
    class_name: str, objects: int, views: int, seed: str | int, condition: str = "2048"
) -> SceneSet:
    """Return the first validation objects of a class, with random clouds and views.

    objects    their number
    views      number of views of each
    seed       of the random views, points and degradation
    condition  by which clouds are degraded

    Raises BadInput for an unknown condition.
    """
    perturbation = find(condition, CONDITIONS, "condition").perturbation
    meshes, clouds, views_of_all = [], [], []
    for i in range(objects):
        mesh = ProceduralObject(class_name, "validation", i).load()
        cloud = sample_surface(mesh, generator("noise floor", "cloud", seed, i))
        degraded = perturbation.apply(cloud, generator("noise floor", condition, seed, i))
        meshes.append(mesh)
        clouds.append(degraded)
        views_of_all.append(random_views(views, generator("noise floor", "views", seed, i)))
    return SceneSet(meshes=tuple(meshes), clouds=tuple(clouds), views=tuple(views_of_all))


def draw_all(
    renderer: Renderer, clouds: Sequence[PointCloud], views: Sequence[Sequence[View]]
) -> UInt8Images:
    """Return images [N, V, H, W, 3] of N clouds, each from its V views.

    renderer  of a method that uses no random numbers
    """
    unused = np.random.default_rng(0)
    images = []
    for cloud, of_cloud in zip(clouds, views, strict=True):
        state = renderer.prepare(cloud, unused)
        images.append(to_uint8(renderer.draw(state, of_cloud, unused)))
    return np.stack(images)


def render_all(meshes: Sequence[Mesh], views: Sequence[Sequence[View]]) -> UInt8Images:
    """Return the true images [N, V, H, W, 3] of N meshes, each from its V views."""
    return np.stack([render(mesh, some) for mesh, some in zip(meshes, views, strict=True)])


def turned(views: Sequence[View]) -> tuple[View, ...]:
    """Return the views with azimuths that are TURN_DEG larger."""
    return tuple(replace(view, azimuth_deg=view.azimuth_deg + TURN_DEG) for view in views)


class Outputs(NamedTuple):
    """The outputs of the bundled networks for images, each [objects, views, d].

    colour   features of the views network
    grey     the same, of the images in grey
    alexnet  features of AlexNet
    answers  what the judge tells of images
    """

    colour: NDArray[np.floating]
    grey: NDArray[np.floating]
    alexnet: NDArray[np.floating]
    answers: NDArray[np.floating]


class FeatureNetworks:
    """The bundled networks that make features of images, as in a run."""

    def __init__(self) -> None:
        self.views = load_views_network(VIEWS_WEIGHTS)
        self.judge = load_judge_network(JUDGE_WEIGHTS)
        self.alexnet = Lpips(find_lpips_weights())

    def __call__(self, images: UInt8Images) -> Outputs:
        """Return the outputs for images [objects, views, H, W, 3]."""
        objects, views = images.shape[:2]
        flat = images.reshape(-1, *images.shape[2:])
        grey = np.repeat(greyscale(flat)[..., None], 3, axis=-1)
        alexnet = self.alexnet.encode(flat).features.numpy()
        return Outputs(
            colour=view_features(self.views, flat).reshape(objects, views, -1),
            grey=view_features(self.views, grey).reshape(objects, views, -1),
            alexnet=alexnet.reshape(objects, views, -1),
            answers=judge(self.judge, flat).reshape(objects, views, -1),
        )


def cells(
    truth: UInt8Images,
    truth_outputs: Outputs,
    drawn: UInt8Images,
    outputs: Outputs,
    views: Sequence[Sequence[View]],
) -> dict[str, float]:
    """Return the value of each of METRICS over all images of chairs, as tables of a run have it.

    truth, drawn            images [N, V, H, W, 3]
    truth_outputs, outputs  of the feature networks for these
    views                   V views of each chair

    Scores of images are means over those that have one; the judge's errors are medians.
    """
    pairs = zip(truth, drawn, strict=True)
    scored = [all_scores(true_images, images) for true_images, images in pairs]
    values = {}
    for metric in IMAGE_METRICS:
        of_images = np.concatenate([scores_of_chair[column(metric)] for scores_of_chair in scored])
        values[metric] = finite_mean(of_images)
    for metric, features, others in zip(DISTANCES, truth_outputs, outputs, strict=False):
        values[metric] = frechet_distance(_flat(features), _flat(others))
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
    """Return all image metrics [V] of images [V, H, W, 3], by the names of columns of records."""
    return scores(truth, drawn) | {"lpips": lpips(truth, drawn, single=True)}


def finite_mean(values: NDArray[np.float64]) -> float:
    """Return the mean of the finite values; NaN where no value is finite."""
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if len(finite) else float("nan")


def _flat(features: NDArray[np.floating]) -> NDArray[np.floating]:
    """Return the features of all images, [objects * views, d]."""
    return features.reshape(-1, features.shape[-1])
