"""Metrics of other packages: what scores a picture against the true one.

A package announces one by an entry point of the group `pc2pix_bench.metrics`: the name is the
metric's id, the object an `ImageMetric`. `bench score` takes it of the pictures of a finished run.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, NamedTuple

from bench.catalogue.lookup import find
from data_prep.failures import BadInput

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

    import numpy as np
    from numpy.typing import NDArray

PLUGINS = "pc2pix_bench.metrics"
_ID = re.compile("[a-z0-9]+(-[a-z0-9]+)*")  # names files


@dataclass(frozen=True)
class ImageMetric:
    """A score of pictures.

    score    of true and drawn pictures, uint8 [V, H, W, 3] each: float64 [V], finite. The pictures
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
    from importlib.metadata import entry_points

    return tuple(sorted(entry_points(group=PLUGINS).names))


def find_metric(metric_id: str) -> ImageMetric:
    """The metric with this id.

    Raises BadInput for an unknown id, naming the nearest, and where a package announces a metric
    that it does not have.
    """
    from importlib.metadata import entry_points

    if not metric_ids():
        raise BadInput(
            f"unknown metric '{metric_id}': no installed package adds one; those of the suites are "
            "in their tables already"
        )
    entries = [_Announced(entry.name, entry) for entry in entry_points(group=PLUGINS)]
    entry = find(metric_id, entries, "metric").entry
    where = f"metric '{metric_id}' of {entry.dist.name if entry.dist else entry.value}"
    try:
        metric = entry.load()
    except Exception as error:  # whatever a stranger's module raises
        raise BadInput(
            f"{where}: {entry.value} cannot be loaded ({type(error).__name__}: {error}); mend or "
            "remove that package"
        ) from error
    if not isinstance(metric, ImageMetric) or metric.id != metric_id:
        raise BadInput(
            f"{where}: {entry.value} is not a bench.image_metric.ImageMetric with that id; mend or "
            "remove that package"
        )
    if not _ID.fullmatch(metric_id):
        raise BadInput(f"{where}: an id is kebab-case, it names files; rename it")
    return metric


class _Announced(NamedTuple):
    id: str
    entry: EntryPoint
