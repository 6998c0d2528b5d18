"""The metrics that `bench score` takes of a finished run: ours on request, and other packages'."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING

from bench.catalogue.metrics import (
    COSTLY_IMAGE_METRICS,
    DISTS,
    KERNEL_METRICS,
    NEIGHBOUR_METRICS,
    ON_REQUEST,
    Extractor,
    WeightsSource,
    extractor_of,
    find_extractor,
    higher_is_better,
)
from bench.catalogue.plugins import ImageMetric, SetMetric, find_metric

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from bench.metrics.dists import Dists


def find_scorer(metric_id: str) -> ImageMetric | SetMetric:
    """Return the metric on request, or of another package, with this id.

    Nothing is loaded. Raises BadInput as `bench.catalogue.plugins.find_metric`.
    """
    if metric_id not in ON_REQUEST:
        return find_metric(metric_id)
    if metric_id in COSTLY_IMAGE_METRICS:
        higher, about = higher_is_better(metric_id), COSTLY_IMAGE_METRICS[metric_id]
        return ImageMetric(metric_id, _dists, 1, higher, about)
    source = find_extractor(extractor_of(metric_id))
    made = (KERNEL_METRICS | NEIGHBOUR_METRICS).get(metric_id)
    about = made[1] if made else f"Fréchet distance: {source.about}"
    return SetMetric(metric_id, lambda images: _extractor(source.id)(images), source.version, about)


def weights_of(metric_id: str) -> WeightsSource | None:
    """Return the source of the weights of a metric on request; None for any other metric."""
    if metric_id not in ON_REQUEST:
        return None
    return DISTS if metric_id == DISTS.id else find_extractor(extractor_of(metric_id))


@functools.cache
def _extractor(extractor_id: str) -> Extractor:
    source = find_extractor(extractor_id)
    return source.load(str(source.weights(None)))


@functools.cache
def _dists_network() -> Dists:
    import torch

    from bench.metrics.dists import load_dists
    from bench.metrics.lpips_weights import find_lpips_weights

    return load_dists(DISTS.weights(None), find_lpips_weights("vgg"), torch.float32)


def _dists(truth: NDArray[np.uint8], drawn: NDArray[np.uint8]) -> NDArray[np.float64]:
    return _dists_network().distance(truth, drawn)
