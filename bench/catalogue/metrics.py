"""The metrics of the benchmark, each a row of `metrics.csv`, and the extractors that some need.

An *extractor* is a network that turns an image into a vector of features. Only the Fréchet distance
on the features of the published Inception network is called `fid`, and only the kernel distance on
the same features is called `kid`.
"""

from __future__ import annotations

import csv
import functools
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING

from bench.catalogue.loaders import GPU, chosen_device
from bench.catalogue.lookup import find
from bench.judges import JUDGE_WEIGHTS, VIEWS_WEIGHTS
from bench.metrics.inception_weights import WeightsUnavailable, find_weights
from bench.metrics.packaged_weights import find_lpips_weights

if TYPE_CHECKING:  # NumPy is slow to import, and `bench list` does not need it
    import numpy as np
    from numpy.typing import NDArray

    from bench.metrics.lpips_network import Lpips


@dataclass(frozen=True)
class _Metric:
    """A metric that tables show.

    kind       image        compares each image with the true one (`bench.metrics.image_scores`);
                            suites compute it in each run
               further      compares images in the same way, but belongs to no suite: `bench score`
                            computes it from the images that a run has stored
               set          the Fréchet distance between two sets of images, on the features of an
                            extractor
               kernel       the kernel distance between two sets of images, on such features
               recognition  a value for each image, computed from the features of a set metric
               control      tells whether an image shows the view and the object that it should. A
                            judge, which is an extractor, too, predicts both from the image alone
    low, high  the lowest and the highest possible value, beyond which no interval goes
    higher     whether higher values are better
    decimals   digits after the decimal point in tables
    undefined  why an image may have no value of this metric; "" where every image has one
    extractor  the id of the extractor that it needs; "" where it needs none, or where the extractor
               has the id of the metric
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
            yield _Metric(
                low=float(row.pop("low") or -inf),
                high=float(row.pop("high") or inf),
                higher=row.pop("better") == "higher",
                decimals=int(row.pop("decimals")),
                **row,
            )


METRICS = {metric.id: metric for metric in _rows()}


def _ids_of_kind(kind: str) -> tuple[str, ...]:
    return tuple(metric.id for metric in METRICS.values() if metric.kind == kind)


IMAGE_METRICS = _ids_of_kind("image")
FURTHER_METRICS = _ids_of_kind("further")
SET_METRICS = _ids_of_kind("set")
KERNEL_METRICS = _ids_of_kind("kernel")
RECOGNITION_METRICS = _ids_of_kind("recognition")
CONTROL_METRICS = _ids_of_kind("control")
# Increase this version with a change of the code that changes a value of any of FURTHER_METRICS.
FURTHER_VERSION = 1
JUDGE = "judge"
FID = "fid"
Extractor = Callable[["NDArray[np.uint8]"], "NDArray[np.float32]"]


@dataclass(frozen=True)
class FeatureSource:
    """An extractor: it computes features float32 [N, d] of images uint8 [N, H, W, 3].

    version  increase this number by hand with a change of the code that changes the features
    weights  a function that returns the file of weights. It is given the file that the command line
             names, or None. It raises WeightsUnavailable where there is no file, and then the
             metrics that need this extractor are skipped
    build    a function that returns the extractor, given that file's path and PyTorch's name of a
             device
    """

    id: str
    version: int
    weights: Callable[[str | None], Path]
    build: Callable[[str, str], Extractor]

    def load(self, weights: str, device: str) -> Extractor:
        """Return the extractor with the weights of a file on a device: "auto", "cpu" or "cuda".

        On every device features are computed in full float32 (`learning.exact`), so that those of
        two devices differ only by rounding. Raises BadInput for unusable weights, and
        MissingDependency where "cuda" is wanted and there is no GPU.
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
    # The images of the last call and their features. Where images are grey, fd-views-grey asks for
    # the features of the same images as fd-views just before.
    last_images: NDArray[np.uint8] | None = None
    last_features: NDArray[np.float32] | None = None

    def features(images: NDArray[np.uint8]) -> NDArray[np.float32]:
        nonlocal last_images, last_features
        is_known = last_images is not None and np.array_equal(last_images, images)
        if last_features is None or not is_known:
            last_features = view_features(model, images)
            last_images = images.copy()
        return last_features

    return features


def _views_grey(weights: str, device: str) -> Extractor:
    import numpy as np

    from bench.judges.judge import greyscale

    features = _views(weights, device)
    return lambda images: features(np.repeat(greyscale(images)[..., None], 3, axis=-1))


def metrics_device(device: str) -> str:
    """Return the device on which a run computes the networks of its metrics: "cuda" or "cpu".

    It is "cuda" where `device`, that of the run, is "cuda". For the device "auto" it is "cpu": a
    run still has the device "auto" where there is no GPU, or where a cluster draws
    (`bench.running.options.device_of`). Nodes of a cluster may differ in this, and all images of a
    run have to be measured on the same kind of device.
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


def _views_file(given: str | None) -> Path:
    del given  # the command line names no file for this network
    return VIEWS_WEIGHTS


def _alexnet_file(given: str | None) -> Path:
    del given  # the command line names no file for this network
    return find_lpips_weights()


def _judge_file(given: str | None) -> Path:
    del given  # the command line names no file for this network
    if not JUDGE_WEIGHTS.is_file():
        raise WeightsUnavailable(f"{JUDGE_WEIGHTS} is missing; install pc2pix-bench again")
    return JUDGE_WEIGHTS


EXTRACTORS = (
    FeatureSource(FID, version=1, weights=find_weights, build=_fid),
    FeatureSource("fd-views", version=3, weights=_views_file, build=_views),
    FeatureSource("fd-views-grey", version=3, weights=_views_file, build=_views_grey),
    FeatureSource("fd-alexnet", version=1, weights=_alexnet_file, build=_alexnet),
    FeatureSource(JUDGE, version=2, weights=_judge_file, build=_judge),
)


def find_extractor(extractor_id: str) -> FeatureSource:
    """Return the extractor with this id. Raises BadInput for an unknown one."""
    return find(extractor_id, EXTRACTORS, "metric")


# The image metrics of other packages that `declare_metric` was called for, by their ids. None has
# an id of METRICS: `bench.catalogue.plugins` refuses a package that announces one.
_DECLARED: dict[str, _Metric] = {}


def declare_metric(metric_id: str, higher_is_better: bool, decimals: int) -> None:
    """Make an image metric of another package known to the functions below, in this process."""
    _DECLARED[metric_id] = _Metric(
        kind="further", id=metric_id, about="", higher=higher_is_better, decimals=decimals
    )


def declared_metric(metric_id: str) -> _Metric | None:
    """Return what `declare_metric` was told about a metric; None where it was not called for it."""
    return _DECLARED.get(metric_id)


def metric_facts(metric_id: str) -> _Metric:
    """Return the description of a metric. An unknown one has the kind "" and no limits."""
    known = METRICS.get(metric_id) or _DECLARED.get(metric_id)
    return known or _Metric(kind="", id=metric_id, about="")


def extractor_of(metric: str) -> str:
    """Return the id of the extractor that a set metric or a learned image metric needs."""
    return metric_facts(metric).extractor or metric


def is_mean(metric: str) -> bool:
    """Return whether a value in a table is a mean over objects, and no median or set distance."""
    return metric_facts(metric).kind in ("image", "further", "recognition")


def value_range(metric: str) -> tuple[float, float]:
    """Return the lowest and the highest value that a metric can have; infinite without a limit."""
    facts = metric_facts(metric)
    return facts.low, facts.high


def higher_is_better(metric: str) -> bool:
    """Return whether higher values of a metric are better."""
    return metric_facts(metric).higher


def column(metric: str) -> str:
    """Return the name of the column that an image metric has in the records of a run."""
    return metric.replace("-", "_")
