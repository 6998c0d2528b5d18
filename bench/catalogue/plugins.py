"""Metrics of kept images: scores of images against the true ones, and distances of sets.

They are `FURTHER_METRICS` and those of other packages. A package announces one by
an entry point, whose name is the metric's id: of the group `pc2pix_bench.metrics` an `ImageMetric`,
of `pc2pix_bench.extractors` a `SetMetric`. `bench score` takes it of the images of a finished run.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from bench.catalogue.conditions import OUR_CONDITIONS
from bench.catalogue.methods import OUR_FAMILIES
from bench.catalogue.metrics import (
    FURTHER_METRICS,
    FURTHER_VERSION,
    METRICS,
    WeightsUnavailable,
    extractor_of,
    find_extractor,
)
from data_prep.failures import BadInput, unknown
from data_prep.plugins import (
    EXTRACTORS,
    OUR_KINDS,
    announced,
    entry_point_names,
    load_entry_point,
    refusal,
)

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@dataclass(frozen=True)
class ImageMetric:
    """A score of images.

    score    of true and drawn images, uint8 [V, H, W, 3] each: float64 [V], finite. The images
             of one object, those of its views; no score may depend on the others. Raises
             WeightsUnavailable where something optional is not installed: then it is skipped
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
    """Distances between sets of images by the features of a network.

    features  of images uint8 [V, H, W, 3]: real numbers [V, d], finite; d is the same for all
              images, and the features of an image depend on no other. Raises WeightsUnavailable
              where something optional is not installed: then it is skipped
    version   raised by hand when a change alters the values; it stands in the tables
    about     one line for people
    """

    id: str
    features: Callable[[NDArray[np.uint8]], NDArray[np.floating]]
    version: int
    about: str


# By kind: the ids of this project, which no plug-in may have.
OUR_IDS = {
    "method": OUR_FAMILIES,
    "metric": METRICS.keys(),
    "dataset": OUR_KINDS,
    "condition": OUR_CONDITIONS,
}


def find_metric(metric_id: str, device: str = "cpu") -> ImageMetric | SetMetric:
    """Return the metric with this id, one of the further ones or of an installed package.

    A network of the further ones runs on `device`: "auto", "cpu" or "cuda".
    Raises BadInput for an unknown id, naming the nearest, for a metric that every run has, and
    where a package announces a metric that it does not have, or by an id that is refused.
    """
    if metric_id in FURTHER_METRICS:
        return _further(metric_id, device)
    if metric_id not in announced("metric"):
        if metric_id in METRICS:
            raise BadInput(
                f"metric '{metric_id}': {_lacking(metric_id)}suites that have it take it by "
                "themselves; leave --metrics"
            )
        raise unknown(metric_id, (*FURTHER_METRICS, *announced("metric")), "metric")
    if metric_id in entry_point_names(EXTRACTORS):
        type_, named = SetMetric, "bench.catalogue.plugins.SetMetric"
    else:
        type_, named = ImageMetric, "bench.image_metric.ImageMetric"
    return load_entry_point("metric", metric_id, type_, named, OUR_IDS["metric"])


def _lacking(metric_id: str) -> str:
    """Return the cause and the remedy where a metric of suites has no weights here; else ""."""
    try:
        find_extractor(extractor_of(metric_id)).weights(None)
    except WeightsUnavailable as error:
        return f"{error}; "
    except BadInput:  # a metric without weights of its own
        pass
    return ""


def _further(metric_id: str, device: str) -> ImageMetric:
    def score(truth: NDArray[np.uint8], drawn: NDArray[np.uint8]) -> NDArray[np.float64]:
        from bench.metrics.image_scores import further_score  # `bench list` needs none of them

        return further_score(metric_id, device)(truth, drawn)

    facts = METRICS[metric_id]
    return ImageMetric(metric_id, score, FURTHER_VERSION, facts.higher, facts.about)


def plugin_problem(kind: str, id_: str) -> str:
    """Return why what packages announce under an id cannot be used; "" where it can, or is none.

    `kind` is "method", "metric", "dataset" or "condition". Nothing is loaded.
    """
    return refusal(kind, id_, OUR_IDS[kind]) if id_ in announced(kind) else ""


def plugin_problems() -> tuple[str, ...]:
    """Return the problems of all ids that installed packages announce."""
    problems = (plugin_problem(kind, id_) for kind in OUR_IDS for id_ in announced(kind))
    return tuple(filter(None, problems))
