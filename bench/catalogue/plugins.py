"""The metrics that `bench score` computes from the stored images of a finished run.

They are our own `FURTHER_METRICS` and the metrics of other packages. Another package announces a
metric by an entry point whose name is the metric's id. In the group `pc2pix_bench.metrics` its
object is an `ImageMetric`, which scores each image against the true one; in the group
`pc2pix_bench.extractors` it is a `SetMetric`, a distance between sets of images.
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
    """A metric that scores each drawn image against the true one.

    score    a function of the true and the drawn images of one object, each uint8 [V, H, W, 3] with
             an image of each of V views. It returns finite scores, float64 [V]; the score of a view
             must not depend on the other views. It raises WeightsUnavailable where an optional part
             of the package is not installed, and then the metric is skipped
    version  increase this number by hand with a change of the code that changes the scores; tables
             name it
    about    one line that tells a user what the metric measures
    """

    id: str
    score: Callable[[NDArray[np.uint8], NDArray[np.uint8]], NDArray[np.float64]]
    version: int
    higher_is_better: bool
    about: str


@dataclass(frozen=True)
class SetMetric:
    """A metric that is the Fréchet distance between sets of images, on features of a network.

    features  a function of images uint8 [V, H, W, 3] that returns their features, finite real
              numbers [V, d]. The number d is the same for all images, and the features of an image
              must not depend on other images. It raises WeightsUnavailable where an optional part
              of the package is not installed, and then the metric is skipped
    version   increase this number by hand with a change of the code that changes the features;
              tables name it
    about     one line that tells a user what the metric measures
    """

    id: str
    features: Callable[[NDArray[np.uint8]], NDArray[np.floating]]
    version: int
    about: str


# The ids of this project, which no plug-in may have, by the kind of plug-in.
OUR_IDS = {
    "method": OUR_FAMILIES,
    "metric": METRICS.keys(),
    "dataset": OUR_KINDS,
    "condition": OUR_CONDITIONS,
}


def find_metric(metric_id: str, device: str = "cpu") -> ImageMetric | SetMetric:
    """Return the metric with this id: one of `FURTHER_METRICS`, or of an installed package.

    If one of `FURTHER_METRICS` needs a network, that runs on `device`: "auto", "cpu" or "cuda".

    Raises BadInput for an unknown id, with the nearest known one in the message; for a metric that
    runs compute by themselves; for a package that announces a metric which it does not contain; and
    for an id that packages may not use.
    """
    if metric_id in FURTHER_METRICS:
        return _further(metric_id, device)
    if metric_id not in announced("metric"):
        if metric_id in METRICS and METRICS[metric_id].kind == "surface":
            raise BadInput(f"metric '{metric_id}': is of meshes; run 'bench surface DIR'")
        if metric_id in METRICS:
            raise BadInput(
                f"metric '{metric_id}': {_lacking(metric_id)}suites that have it take it by "
                "themselves; leave --metrics"
            )
        raise unknown(metric_id, (*FURTHER_METRICS, *announced("metric")), "metric")
    if metric_id in entry_point_names(EXTRACTORS):
        type_, type_name = SetMetric, "bench.catalogue.plugins.SetMetric"
    else:
        type_, type_name = ImageMetric, "bench.image_metric.ImageMetric"
    return load_entry_point("metric", metric_id, type_, type_name, OUR_IDS["metric"])


def _lacking(metric_id: str) -> str:
    """Return why a metric of suites has no weights here, with the remedy; "" where it has them."""
    try:
        find_extractor(extractor_of(metric_id)).weights(None)
    except WeightsUnavailable as error:
        return f"{error}; "
    except BadInput:  # there is no such extractor: the metric needs no weights
        pass
    return ""


def _further(metric_id: str, device: str) -> ImageMetric:
    def score(truth: NDArray[np.uint8], drawn: NDArray[np.uint8]) -> NDArray[np.float64]:
        from bench.metrics.image_scores import further_score  # slow to import

        return further_score(metric_id, device)(truth, drawn)

    facts = METRICS[metric_id]
    return ImageMetric(metric_id, score, FURTHER_VERSION, facts.higher, facts.about)


def plugin_problem(kind: str, id_: str) -> str:
    """Return why the plug-in with this id cannot be used; "" where it can, and without one.

    `kind` is "method", "metric", "dataset" or "condition". The code of the plug-in is not loaded.
    """
    return refusal(kind, id_, OUR_IDS[kind]) if id_ in announced(kind) else ""


def plugin_problems() -> tuple[str, ...]:
    """Return why plug-ins of installed packages cannot be used, a line for each of these."""
    problems = []
    for kind in OUR_IDS:
        for id_ in announced(kind):
            problem = plugin_problem(kind, id_)
            if problem:
                problems.append(problem)
    return tuple(problems)
