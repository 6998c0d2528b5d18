"""The metrics of the benchmark, as literal tables.

Image metrics score an image against the true one. Set metrics are distances between sets of images,
on features that an extractor takes of each: uint8 [N, H, W, 3] to float32 [N, d]. Nothing but the
Fréchet distance on the published Inception features is called `fid`, and nothing but the kernel
distance on these `kid`. Control metrics ask
whether an image shows the view and the object that it should; a judge predicts them from the
image alone, and its answers are features too, which no distance is taken of.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from bench.catalogue.loaders import GPU, chosen_device
from bench.catalogue.lookup import find
from bench.judges import JUDGE_WEIGHTS, VIEWS_WEIGHTS
from bench.metrics.inception_weights import WeightsUnavailable, find_weights
from bench.metrics.learned_weights import find_dists_weights
from bench.metrics.lpips_weights import find_lpips_weights

if TYPE_CHECKING:  # `bench list` answers at once
    import numpy as np
    from numpy.typing import NDArray

    from bench.metrics.lpips_network import Lpips

# Every run has them, from `bench.metrics.image_scores`; `column` gives their names in the records.
IMAGE_METRICS = {
    "ssim": "structural similarity, mean of the product of the next three; 1 is identical",
    "luminance": "mean brightness, a component of ssim",
    "contrast": "variance around the mean, a component of ssim",
    "structure": "correlation, the component of ssim that the paper argues with",
    "psnr": "peak signal-to-noise ratio in dB; identical images have 95.05, the most",
    "ssim-object": "ssim of the windows that meet the true or the drawn object; 1 is identical",
    "silhouette-iou": "intersection over union of the drawn and the true silhouette",
    "thin-recall": "share of the thin parts of the true object that is drawn",
    "thin-precision": "share of what is drawn beside thin parts that is true object",
    "lpips": "distance by the features of a network for photographs; 0 is identical",
}
# Metrics of images that no suite has: `bench run --metrics` and `bench score` take them of the
# images that a run has kept, by `bench.metrics.image_scores.FURTHER_SCORES`.
FURTHER_METRICS = {
    "ms-ssim": "ssim at four scales, multiplied; 1 is identical",
    "cw-ssim": "ssim of complex wavelets, which hardly notices small shifts; 1 is identical",
    "flip": "difference seen when flipping between both images; 0 is identical",
    "dists": "structure and texture of the features of VGG16; 0 is identical",
}
FURTHER_VERSION = 1  # raise when a change alters one of their values
# The least and the largest value that a metric can have, for intervals; others have no limit.
RANGES = {
    "ssim": (-1.0, 1.0),
    "luminance": (0.0, 1.0),
    "contrast": (0.0, 1.0),
    "structure": (-1.0, 1.0),
    "psnr": (0.0, 95.05),
    "ssim-object": (-1.0, 1.0),
    "silhouette-iou": (0.0, 1.0),
    "thin-recall": (0.0, 1.0),
    "thin-precision": (0.0, 1.0),
    "lpips": (0.0, math.inf),
    "ms-ssim": (0.0, 1.0),
    "cw-ssim": (0.0, 1.0),
    "flip": (0.0, 1.0),
    "dists": (0.0, math.inf),
    "class-confidence": (0.0, 1.0),
    "retrieval": (0.0, 1.0),
}
# Why an image metric may have no value for an image that is there; the others always have one.
UNDEFINED = {
    "ssim-object": "the true image shows nothing, and nothing is drawn",
    "thin-recall": "the true object shows no part thinner than 4 px",
    "thin-precision": "no part thinner than 4 px, or nothing drawn beside one",
}
CONTROL_METRICS = {
    "azimuth-error-deg": "median error of the azimuth that the judge sees",
    "elevation-error-deg": "median error of the elevation that the judge sees",
    "retrieval": "share of images by which the judge finds the object among those of the run",
}
# Made from the features of a set metric: of an image, and of a set (and which set metric's).
RECOGNITION_METRICS = {
    "class-confidence": "probability that the classifier of fd-views gives the true class",
}
KERNEL_METRICS = {
    "kid": ("fid", "kernel distance on the features of fid, unbiased for few images"),
    "kd-views": ("fd-views", "kernel distance on the features of fd-views"),
    "kd-alexnet": ("fd-alexnet", "kernel distance on the features of fd-alexnet"),
}
# Image metrics that the network of an extractor computes on its way to the features.
LEARNED_METRICS = {"lpips": "fd-alexnet"}
DISTANCES_OF_IMAGES = ("lpips", "dists", "flip")
JUDGE = "judge"
FID = "fid"
Extractor = Callable[["NDArray[np.uint8]"], "NDArray[np.float32]"]


@dataclass(frozen=True)
class WeightsSource:
    """A metric with weights.

    `weights` finds the file to load, given the option of the command line; it raises
    WeightsUnavailable where there is none, and then the metric is skipped.
    """

    id: str
    weights: Callable[[str | None], Path]


@dataclass(frozen=True)
class FeatureSource(WeightsSource):
    """An extractor of features of images, which gives its name to a metric of sets.

    `build` takes the path that `weights` finds, and PyTorch's name of a device. `version` is raised
    by hand when a change alters the features.
    """

    build: Callable[[str, str], Extractor]
    version: int
    about: str

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


def _installed_alexnet(chosen: str | None) -> Path:
    del chosen
    return find_lpips_weights()


def _installed_dists(chosen: str | None) -> Path:
    del chosen
    return find_dists_weights()


def _bundled_judge(chosen: str | None) -> Path:
    del chosen
    if not JUDGE_WEIGHTS.is_file():
        raise WeightsUnavailable(
            f"{JUDGE_WEIGHTS.name} is not bundled; 'bench train judge' makes it"
        )
    return JUDGE_WEIGHTS


def _bundled_views(chosen: str | None) -> Path:
    del chosen
    return VIEWS_WEIGHTS


SET_METRICS = (
    FeatureSource(
        "fid",
        find_weights,
        _fid,
        1,
        "Inception features of 2015-12-05, as in TTUR and torch-fidelity",
    ),
    FeatureSource(
        "fd-views",
        _bundled_views,
        _views,
        3,
        "features of the bundled classifier of rendered views",
    ),
    FeatureSource(
        "fd-views-grey",
        _bundled_views,
        _views_grey,
        3,
        "fd-views on greyscaled images: of colour only the luma counts",
    ),
    FeatureSource(
        "fd-alexnet",
        _installed_alexnet,
        _alexnet,
        1,
        "features of AlexNet, trained on photographs: mean of the last convolution",
    ),
)
DISTS = WeightsSource("dists", _installed_dists)


EXTRACTORS = (
    *SET_METRICS,
    FeatureSource(
        JUDGE,
        _bundled_judge,
        _judge,
        2,
        "direction of view and shape code, as the bundled judge sees them",
    ),
)


def find_extractor(extractor_id: str) -> FeatureSource:
    """Return the extractor with this id. Raises BadInput for an unknown one."""
    return find(extractor_id, EXTRACTORS, "metric")


def extractor_of(metric: str) -> str:
    """Return the id of the extractor behind a set metric or a learned image metric."""
    if source := KERNEL_METRICS.get(metric):
        return source[0]
    return LEARNED_METRICS.get(metric, metric)


class DeclaredMetric(NamedTuple):
    """The facts of a further image metric: what is better, and digits after the point."""

    higher_is_better: bool
    decimals: int


_DECLARED: dict[str, DeclaredMetric] = {}  # by id; ids of packages are refused where they are ours


def declare_metric(metric_id: str, higher_is_better: bool, decimals: int) -> None:
    """Make a further image metric known to the functions below, in this process."""
    _DECLARED[metric_id] = DeclaredMetric(higher_is_better, decimals)


def declared_metric(metric_id: str) -> DeclaredMetric | None:
    """Return the facts of a further image metric; None for one that is not declared."""
    return _DECLARED.get(metric_id)


def is_mean(metric: str) -> bool:
    """Return whether a metric is a mean over images, not a distance of sets or a median."""
    return metric in {**IMAGE_METRICS, **FURTHER_METRICS, **RECOGNITION_METRICS, **_DECLARED}


def value_range(metric: str) -> tuple[float, float]:
    """Return the least and the largest value that a metric can have; infinite without a limit."""
    if any(metric == source.id for source in SET_METRICS):  # Fréchet distances
        return 0.0, math.inf
    return RANGES.get(metric, (-math.inf, math.inf))


def higher_is_better(metric: str) -> bool:
    """Return whether more of a metric of the tables is better."""
    if metric == "retrieval":
        return True
    if metric in _DECLARED:
        return _DECLARED[metric].higher_is_better
    return is_mean(metric) and metric not in DISTANCES_OF_IMAGES


def column(metric: str) -> str:
    """Return the name of an image metric in the records."""
    return metric.replace("-", "_")
