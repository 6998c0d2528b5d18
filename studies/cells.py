"""The cells of the noise floor: the metrics of images of validation chairs, in any precision."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from bench.catalogue.lookup import find
from bench.catalogue.metrics import CONTROL_METRICS, IMAGE_METRICS, column
from bench.judges import JUDGE_WEIGHTS, VIEWS_WEIGHTS
from bench.judges import answers as control
from bench.judges.judge import greyscale, judge, load_judge_network
from bench.judges.views import load_views_network, view_features
from bench.metrics.frechet import frechet_distance
from bench.metrics.kernel_distance import kernel_distance
from bench.metrics.lpips_network import Lpips
from bench.metrics.lpips_weights import find_lpips_weights
from data_prep.clouds.conditions import CONDITIONS
from data_prep.clouds.sampling import random_views, sample_surface
from data_prep.datasets.registry import ProceduralObject
from data_prep.randomness import generator
from data_prep.scene import Mesh, PointCloud, UInt8Images, View
from studies.images import all_scores

DISTANCES = ("fd-views", "fd-views-grey", "fd-alexnet")
METRICS = (*IMAGE_METRICS, *DISTANCES, "kd-alexnet", *CONTROL_METRICS)
BATCH = 20

Cells = dict[str, float]  # the value of each metric, for one method


@dataclass(frozen=True, eq=False)
class ChairSet:
    """The chairs, clouds and views of a seed; each chair has the same number of views."""

    meshes: tuple[Mesh, ...]
    clouds: tuple[PointCloud, ...]
    views: tuple[tuple[View, ...], ...]


class Outputs(NamedTuple):
    """The outputs of the feature networks for images: [chairs, views, d] each."""

    colour: NDArray[np.floating]
    grey: NDArray[np.floating]
    alexnet: NDArray[np.floating]
    answers: NDArray[np.floating]


class FeatureNetworks:
    """The bundled networks, which turn images into features in float32 (as in a run) or float64."""

    def __init__(self, dtype: torch.dtype) -> None:
        self.dtype = dtype
        self.views = load_views_network(VIEWS_WEIGHTS).to(dtype)
        self.judge = load_judge_network(JUDGE_WEIGHTS).to(dtype)
        self.alexnet = Lpips(find_lpips_weights(), dtype=dtype)

    def __call__(self, images: UInt8Images) -> Outputs:
        """Return features of images [chairs, views, H, W, 3]."""
        flat = images.reshape(-1, *images.shape[2:])
        grey = np.repeat(greyscale(flat)[..., None], 3, axis=-1)
        alexnet = self.alexnet.encode(flat).features.numpy()
        if self.dtype == torch.float32:  # the very functions that a run uses
            outputs = (
                view_features(self.views, flat),
                view_features(self.views, grey),
                alexnet,
                judge(self.judge, flat),
            )
        else:
            outputs = (self._views(flat), self._views(grey), alexnet, self._judge(flat))
        return Outputs(*(values.reshape(*images.shape[:2], -1) for values in outputs))

    @torch.inference_mode()
    def _views(self, images: NDArray[np.uint8]) -> NDArray[np.floating]:
        parts = torch.from_numpy(images).permute(0, 3, 1, 2).split(BATCH)
        features = [
            self.views.body(1 - part.to(self.dtype) / 255).mean(dim=(2, 3)) for part in parts
        ]
        return torch.cat(features).numpy()

    @torch.inference_mode()
    def _judge(self, images: NDArray[np.uint8]) -> NDArray[np.floating]:
        parts = torch.from_numpy(greyscale(images)).split(BATCH)
        return torch.cat([self.judge(1 - p[:, None].to(self.dtype) / 255) for p in parts]).numpy()


def make_chairs(chairs: int, views: int, seed: int, condition: str) -> ChairSet:
    """Return the first validation chairs; `seed` chooses views, points and degradation.

    Raises BadInput for an unknown condition.
    """
    perturbation = find(condition, CONDITIONS, "condition").perturbation
    meshes = tuple(ProceduralObject("chair", "validation", i).load() for i in range(chairs))
    return ChairSet(
        meshes,
        tuple(
            perturbation.apply(
                sample_surface(mesh, generator("noise floor", "cloud", seed, i)),
                generator("noise floor", condition, seed, i),
            )
            for i, mesh in enumerate(meshes)
        ),
        tuple(
            random_views(views, generator("noise floor", "views", seed, i)) for i in range(chairs)
        ),
    )


def cells(
    truth: UInt8Images,
    truth_outputs: Outputs,
    drawn: UInt8Images,
    outputs: Outputs,
    views: Sequence[Sequence[View]],
) -> Cells:
    """Return every metric over all images, as the tables of a run take it.

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
    hits = control.found(among, answers, images)
    values["azimuth-error-deg"] = float(np.median(control.azimuth_error_deg(answers, azimuth)))
    values["elevation-error-deg"] = float(
        np.median(control.elevation_error_deg(answers, elevation))
    )
    values["retrieval"] = float(hits.mean())
    return values


def finite_mean(values: NDArray[np.float64]) -> float:
    """Return the mean of the finite values; NaN where no value is finite."""
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if len(finite) else float("nan")


def _flat(features: NDArray[np.floating]) -> NDArray[np.floating]:
    return features.reshape(-1, features.shape[-1])
