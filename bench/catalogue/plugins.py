"""Metrics of other packages: what scores an image against the true one.

A package announces one by an entry point of the group `pc2pix_bench.metrics`: the name is the
metric's id, the object an `ImageMetric`. `bench score` takes it of the images of a finished run.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, NamedTuple

from bench.catalogue.lookup import announced_ids, find, load_announced
from data_prep.failures import BadInput

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

PLUGINS = "pc2pix_bench.metrics"


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


@cache
def metric_ids() -> tuple[str, ...]:
    """Ids of the metrics that installed packages announce, sorted; none is loaded."""
    return announced_ids(PLUGINS)


def find_metric(metric_id: str) -> ImageMetric:
    """The metric with this id.

    Raises BadInput for an unknown id, naming the nearest, and where a package announces a metric
    that it does not have.
    """
    if not metric_ids():
        raise BadInput(
            f"unknown metric '{metric_id}': no installed package adds one; those of the suites are "
            "in their tables already"
        )
    find(metric_id, [_Announced(one) for one in metric_ids()], "metric")
    named = "bench.image_metric.ImageMetric"
    return load_announced(PLUGINS, metric_id, "metric", ImageMetric, named, names_files=True)


class _Announced(NamedTuple):
    id: str
