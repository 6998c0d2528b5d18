"""Metrics of other packages: scores of images against the true ones, and distances of sets.

A package announces one by an entry point, whose name is the metric's id: of the group
`pc2pix_bench.metrics` an `ImageMetric`, of `pc2pix_bench.extractors` a `SetMetric`. `bench score`
takes it of the images of a finished run.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

from data_prep.announced import EXTRACTORS, METRICS, announced_ids, load_announced
from data_prep.failures import BadInput, unknown

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@dataclass(frozen=True)
class ImageMetric:
    """A score of images.

    score    of true and drawn images, uint8 [V, H, W, 3] each: float64 [V], finite. The images
             of one object, those of its views; no score may depend on the others
    version  raised by hand when a change alters the values; it stands in the tables
    about    one line for people
    """

    id: str
    score: Callable[[NDArray[np.uint8], NDArray[np.uint8]], NDArray[np.float64]]
    version: int
    higher_is_better: bool
    about: str


@dataclass(frozen=True)
class SetMetric:
    """Distances between sets of images, Fréchet and kernel, by the features of a network.

    features  of images uint8 [V, H, W, 3]: real numbers [V, d], finite; d is the same for all
              images, and the features of an image depend on no other
    version   raised by hand when a change alters the values; it stands in the tables
    about     one line for people
    """

    id: str
    features: Callable[[NDArray[np.uint8]], NDArray[np.floating]]
    version: int
    about: str


@cache
def metric_ids() -> tuple[str, ...]:
    """Ids of the metrics that installed packages announce, sorted; none is loaded."""
    return tuple(sorted({*announced_ids(METRICS), *announced_ids(EXTRACTORS)}))


def find_metric(metric_id: str) -> ImageMetric | SetMetric:
    """The metric with this id.

    Raises BadInput for an unknown id, naming the nearest, and where a package announces a metric
    that it does not have.
    """
    if not metric_ids():
        raise BadInput(
            f"unknown metric '{metric_id}': no installed package adds one; those of the suites are "
            "in their tables already"
        )
    if metric_id not in metric_ids():
        raise unknown(metric_id, metric_ids(), "metric")
    if metric_id in announced_ids(EXTRACTORS):
        named = "bench.catalogue.plugins.SetMetric"
        return load_announced(EXTRACTORS, metric_id, "metric", SetMetric, named, names_files=True)
    named = "bench.image_metric.ImageMetric"
    return load_announced(METRICS, metric_id, "metric", ImageMetric, named, names_files=True)
