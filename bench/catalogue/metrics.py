"""The metrics of the benchmark, a row of `metrics.csv` each, and the extractors behind some.

Nothing but the Fréchet distance on the published Inception features is called `fid`, and nothing
but the kernel distance on these `kid`.
"""

from __future__ import annotations

import csv
import functools
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bench.catalogue.loaders import GPU, chosen_device
from bench.catalogue.lookup import find
from bench.judges import JUDGE_WEIGHTS, VIEWS_WEIGHTS
from bench.metrics.inception_weights import WeightsUnavailable, find_weights
from bench.metrics.packaged_weights import find_lpips_weights

if TYPE_CHECKING:  # `bench list` answers at once
    import numpy as np
    from numpy.typing import NDArray

    from bench.metrics.lpips_network import Lpips


@dataclass(frozen=True)
class _Metric:
    """A metric of tables.

    kind       image        of every image of a run and the true one (`bench.metrics.image_scores`)
               further      the same of no suite: on request, of the images that a run has kept
               set          Fréchet distance of sets of images, on the features of an extractor
               kernel       kernel distance of sets of images, on such features
               recognition  made from the features of a set metric, of each image
               control      whether an image shows the view and the object that it should: a judge
                            predicts them from the image alone; its answers are features, too, of
                            which no distance is taken
    low, high  the least and the largest value, for intervals
    higher     whether more is better
    decimals   digits after the point in tables
    undefined  why it may have no value for an image that is there; "" where it always has one
    extractor  whose features or network it needs; "" for none, or where it has the metric's id
    """

    kind: str
    id: str
    about: str
    low: float = -inf
    high: float = inf
    higher: bool = False
    decimals: int = 3
    undefined: str = ""
    extractor: str = ""


def _rows() -> Iterator[_Metric]:
    with Path(__file__).with_suffix(".csv").open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            low, high = float(row.pop("low") or -inf), float(row.pop("high") or inf)
            higher, decimals = row.pop("better") == "higher", int(row.pop("decimals"))
            yield _Metric(low=low, high=high, higher=higher, decimals=decimals, **row)


METRICS = {metric.id: metric for metric in _rows()}


def _of(kind: str) -> tuple[str, ...]:
    return tuple(metric.id for metric in METRICS.values() if metric.kind == kind)


IMAGE_METRICS = _of("image")
FURTHER_METRICS = _of("further")
SET_METRICS = _of("set")
KERNEL_METRICS = _of("kernel")
RECOGNITION_METRICS = _of("recognition")
CONTROL_METRICS = _of("control")
FURTHER_VERSION = 1  # of the further ones: raise when a change alters one of their values
JUDGE = "judge"
FID = "fid"
Extractor = Callable[["NDArray[np.uint8]"], "NDArray[np.float32]"]


@dataclass(frozen=True)
class FeatureSource:
    """An extractor of features of images, uint8 [N, H, W, 3] to float32 [N, d].

    version  raised by hand when a change alters the features
    weights  finds the file to load, given the option of the command line; it raises
             WeightsUnavailable where there is none, and then the metric is skipped
    build    takes the path that `weights` finds, and PyTorch's name of a device
    """

    id: str
    version: int
    weights: Callable[[str | None], Path]
    build: Callable[[str, str], Extractor]

    def load(self, weights: str, device: str) -> Extractor:
        """Return the extractor with the weights of a file on a device: "auto", "cpu" or "cuda".

        Features are computed in full float32 on each (`learning.exact`), and differ by rounding.
        Raises BadInput for unusable weights, and MissingDependency for a GPU where there is none.
        """
        return self.build(weights, chosen_device(device))


def _fid(weights: str, device: str) -> Extractor:
    from bench.metrics.inception import inception_features, load_inception

    model = load_inception(Path(weights)).to(device)
    return lambda images: inception_features(model, images)


@functools.cache
def _views(weights: str, device: str) -> Extractor:
    import numpy as np

    from bench.judges.views import load_views_network, view_features
    from learning.convolution import fold_normalisation

    model = load_views_network(Path(weights))
    fold_normalisation(model)
    model.to(device)
    last: list[NDArray[Any]] = []  # images and their features: of grey images fd-views-grey asks

    def features(images: NDArray[np.uint8]) -> NDArray[np.float32]:
        if not (last and np.array_equal(last[0], images)):
            last[:] = images.copy(), view_features(model, images)
        return last[1]

    return features


def _views_grey(weights: str, device: str) -> Extractor:
    import numpy as np

    from bench.judges.judge import greyscale

    features = _views(weights, device)
    return lambda images: features(np.repeat(greyscale(images)[..., None], 3, axis=-1))


def metrics_device(device: str) -> str:
    """Return the device of the networks of metrics in a run on this device.

    "auto", which `bench.running.options.device_of` leaves where there is no GPU or a cluster draws,
    is the CPU: all images of a run are to be measured on one device, and nodes of a cluster differ.
    """
    return GPU if device == GPU else "cpu"


def lpips_network(weights: str, device: str) -> Lpips:
    """Return the network of `lpips` and `fd-alexnet` on a device: "auto", "cpu" or "cuda"."""
    from bench.metrics.lpips_network import load_lpips

    return load_lpips(Path(weights), device=chosen_device(device))


def _alexnet(weights: str, device: str) -> Extractor:
    network = lpips_network(weights, device)
    return lambda images: network.encode(images).features.cpu().numpy()


def _judge(weights: str, device: str) -> Extractor:
    from bench.judges.judge import judge, load_judge_network
    from learning.convolution import fold_normalisation

    network = load_judge_network(Path(weights))
    fold_normalisation(network)
    network.to(device)
    return lambda images: judge(network, images)


def _bundled_judge(chosen: str | None) -> Path:
    del chosen
    if not JUDGE_WEIGHTS.is_file():
        raise WeightsUnavailable(f"{JUDGE_WEIGHTS} is missing; install pc2pix-bench again")
    return JUDGE_WEIGHTS


EXTRACTORS = (
    FeatureSource(FID, 1, find_weights, _fid),
    FeatureSource("fd-views", 3, lambda _: VIEWS_WEIGHTS, _views),
    FeatureSource("fd-views-grey", 3, lambda _: VIEWS_WEIGHTS, _views_grey),
    FeatureSource("fd-alexnet", 1, lambda _: find_lpips_weights(), _alexnet),
    FeatureSource(JUDGE, 2, _bundled_judge, _judge),
)


def find_extractor(extractor_id: str) -> FeatureSource:
    """Return the extractor with this id. Raises BadInput for an unknown one."""
    return find(extractor_id, EXTRACTORS, "metric")


_DECLARED: dict[str, _Metric] = {}  # by id; ids of packages are refused where they are ours


def declare_metric(metric_id: str, higher_is_better: bool, decimals: int) -> None:
    """Make a further image metric known to the functions below, in this process."""
    _DECLARED[metric_id] = _Metric(
        "further", metric_id, "", higher=higher_is_better, decimals=decimals
    )


def declared_metric(metric_id: str) -> _Metric | None:
    """Return the facts of a further image metric; None for one that is not declared."""
    return _DECLARED.get(metric_id)


def metric_facts(metric_id: str) -> _Metric:
    """Return the row of a metric, one without limits for a metric that is not known."""
    return METRICS.get(metric_id) or _DECLARED.get(metric_id) or _Metric("", metric_id, "")


def extractor_of(metric: str) -> str:
    """Return the id of the extractor behind a set metric or a learned image metric."""
    return metric_facts(metric).extractor or metric


def is_mean(metric: str) -> bool:
    """Return whether a metric is a mean over objects, not a distance of sets or a median."""
    return metric_facts(metric).kind in ("image", "further", "recognition")


def value_range(metric: str) -> tuple[float, float]:
    """Return the least and the largest value that a metric can have; infinite without a limit."""
    return metric_facts(metric).low, metric_facts(metric).high


def higher_is_better(metric: str) -> bool:
    """Return whether more of a metric of the tables is better."""
    return metric_facts(metric).higher


def column(metric: str) -> str:
    """Return the name of an image metric in the records."""
    return metric.replace("-", "_")
