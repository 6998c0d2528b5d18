"""The metrics of the benchmark, as literal tables.

Image metrics score a picture against the true one. Set metrics are Fréchet distances between sets
of pictures, on features that an extractor takes of each: uint8 [N, H, W, 3] to float32 [N, d].
Nothing but the distance on the published Inception features is called `fid`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from bench.inception_weights import WeightsUnavailable, find_weights
from bench.lookup import find

if TYPE_CHECKING:  # `bench list` answers at once
    import numpy as np
    from numpy.typing import NDArray

__all__ = [
    "IMAGE_METRICS",
    "SET_METRICS",
    "Extractor",
    "SetMetric",
    "WeightsUnavailable",
    "find_extractor",
]

# By the names of `bench.ssim.SsimPerImage`, which computes all four.
IMAGE_METRICS = {
    "ssim": "structural similarity, mean of the product of the next three; 1 is identical",
    "luminance": "its component: mean brightness",
    "contrast": "its component: variance around the mean",
    "structure": "its component: correlation, what the paper argues for",
}
VIEWS_WEIGHTS = Path(__file__).with_name("views_network.safetensors")  # no torch to find it
Extractor = Callable[["NDArray[np.uint8]"], "NDArray[np.float32]"]


@dataclass(frozen=True)
class SetMetric:
    """A Fréchet distance by the features it is taken of.

    `weights` finds the file to load, given the wish of the command line; it raises
    WeightsUnavailable where there is none, and then the metric is skipped. `load` takes that path.
    `version` is raised by hand when a change alters the features.
    """

    id: str
    weights: Callable[[str | None], Path]
    load: Callable[[str], Extractor]
    version: int
    about: str


def _fid(weights: str) -> Extractor:
    from bench.inception import inception_features, load_inception

    model = load_inception(Path(weights))
    return lambda images: inception_features(model, images)


def _views(weights: str) -> Extractor:
    from bench.views_network import load_views_network, view_features

    model = load_views_network(Path(weights))
    return lambda images: view_features(model, images)


def _bundled_views(wish: str | None) -> Path:
    del wish
    return VIEWS_WEIGHTS


SET_METRICS = (
    SetMetric(
        "fid",
        find_weights,
        _fid,
        1,
        "Inception features of 2015-12-05, as in TTUR and torch-fidelity",
    ),
    SetMetric(
        "fd-views",
        _bundled_views,
        _views,
        1,
        "features of the bundled classifier of rendered views",
    ),
)


def find_extractor(metric_id: str) -> SetMetric:
    """The set metric with this id. Raises BadInput for an unknown one."""
    return find(metric_id, SET_METRICS, "metric")
