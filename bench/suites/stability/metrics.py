"""Metrics at the edges of their domain: cases by metrics, and the value or refusal of each.

The cases are those of `image_cases`, `similarity_cases`, `feature_cases` and `learned_cases`.
"""

from __future__ import annotations

import functools
import math
import warnings
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

from bench.catalogue.metrics import JUDGE
from bench.judges.answers import azimuth_error_deg, elevation_error_deg
from bench.metrics.frechet import frechet_distance
from bench.metrics.image_scores import FURTHER_SCORES, scores
from bench.metrics.inception_weights import WeightsUnavailable
from bench.metrics.peak_signal_to_noise import psnr
from bench.metrics.silhouette import silhouette_iou
from bench.metrics.structural_similarity import ssim_per_image
from bench.metrics.thin_parts import thin_scores
from bench.running.isolation import library_threads
from bench.suites.stability.expectations import Kind
from bench.suites.stability.feature_cases import (
    ANGLE_CASES,
    FRECHET_CASES,
    NETWORK_CASES,
    extractor,
)
from bench.suites.stability.image_cases import INPUT_CASES, SILHOUETTE_CASES, SSIM_CASES, THIN_CASES
from bench.suites.stability.learned_cases import ALEXNET_CASES, LEARNED_CASES
from bench.suites.stability.metric_cases import (
    FD_VIEWS,
    FRECHET,
    SSIM,
    Array,
    ArrayPair,
    MetricCase,
    MetricExpectation,
    Number,
    Refused,
)
from bench.suites.stability.outcomes import CaseOutcome
from bench.suites.stability.similarity_cases import SIMILARITY_CASES
from data_prep.arrays import Floats
from data_prep.scene import UInt8Images

CASES = (
    SSIM_CASES
    + THIN_CASES
    + SILHOUETTE_CASES
    + INPUT_CASES
    + SIMILARITY_CASES
    + NETWORK_CASES
    + ALEXNET_CASES
    + LEARNED_CASES
    + FRECHET_CASES
    + ANGLE_CASES
)
DISTANCES = (FRECHET, *FD_VIEWS, "fd-alexnet")
Metric = Callable[[Any, Any], Any]  # of the two arrays of a case


def metric_outcomes(
    cases: Iterable[MetricCase] = CASES, metrics: Mapping[str, Metric] | None = None
) -> list[CaseOutcome]:
    """Return the outcomes of all cases on the metrics that they have an expectation of.

    `metrics` are METRICS by default. It never raises and takes some seconds.
    """
    functions = METRICS if metrics is None else metrics
    with library_threads(1):
        return [
            _outcome(case, metric, functions[metric], stated)
            for case in cases
            for metric, stated in case.stated.items()
        ]


def _outcome(
    case: MetricCase, metric: str, function: Metric, stated: MetricExpectation
) -> CaseOutcome:
    expected = "?"
    try:
        with warnings.catch_warnings():
            # Arithmetic that NumPy warns of is an outcome of its own, which no case expects.
            warnings.simplefilter("error", RuntimeWarning)
            given = case.given()
            if isinstance(stated, Refused):
                expected = f"{stated.error.__name__}: ...{stated.says}..."
                observed, kind = _refusal(function, given, stated)
            else:
                value = np.asarray(_number(stated.value, given), np.float64)
                within = float(_number(stated.within, given))
                expected = f"{_shown(value)} {f'+-{within:.1g}' if within else 'exactly'}: "
                expected += stated.words
                returned = function(*given)
                observed, kind = _compared(returned, value, within, metric in DISTANCES)
    except WeightsUnavailable as error:  # of an optional package: skipped, in runs as well
        observed, kind = f"skipped: {error}", "refused"
    except Exception as error:
        observed, kind = f"{type(error).__name__}: {error}", "unexpected"
    return CaseOutcome(case.id, case.group, metric, expected, observed, kind)


def _refusal(function: Metric, given: ArrayPair, stated: Refused) -> tuple[str, Kind]:
    try:
        returned = function(*given)
    except Exception as error:
        as_stated = type(error) is stated.error and stated.says in str(error)
        return f"{type(error).__name__}: {error}", "refused" if as_stated else "unexpected"
    return _shown(np.asarray(returned)), "unexpected"


def _compared(returned: Any, value: Floats, within: float, is_distance: bool) -> tuple[str, Kind]:
    if is_distance and not (isinstance(returned, float) and 0.0 <= returned < math.inf):
        return f"{returned!r}, which is no distance", "unexpected"
    returned = np.asarray(returned)
    if returned.shape != value.shape and (value.ndim or not returned.size):
        return f"{_shown(returned)} of shape {list(returned.shape)}", "unexpected"
    if not np.array_equal(np.isnan(returned), np.isnan(np.broadcast_to(value, returned.shape))):
        return _shown(returned), "unexpected"
    off = float(np.nanmax(np.abs(returned - value), initial=0.0))
    text = _shown(returned) + (f", off by {off:.1g}" if off else "")
    return text, "holds" if off <= within else "unexpected"


def _number(number: Number, given: ArrayPair) -> Any:
    return number(*given) if callable(number) else number


def _shown(values: Array) -> str:
    texts = ["no value" if np.isnan(value) else f"{value:.15g}" for value in values.ravel()]
    if not texts:
        return "no values"
    if len(set(texts)) == 1:
        return texts[0]
    return ", ".join(texts) if len(texts) < 4 else f"{texts[0]} ... {texts[-1]} ({len(texts)})"


# --- the metrics ----------------------------------------------------------------------------------


def _lpips(truth: UInt8Images, images: UInt8Images) -> Floats:
    from bench.metrics.lpips_network import lpips  # imports torch

    return lpips(truth, images, single=True)


def _between(name: str, truth: UInt8Images, images: UInt8Images) -> float:
    features = extractor(name)
    return frechet_distance(features(truth), features(images))


def _code_lengths(truth: UInt8Images, images: UInt8Images) -> Floats:
    """Return the length of the judge's shape code of each image; NaN if not finite."""
    del truth
    answers = extractor(JUDGE)(images).astype(np.float64)
    return np.linalg.norm(answers[:, 3:], axis=1) + 0.0 * answers[:, :3].sum(axis=1)


def ssim_metrics(per_image: Metric = ssim_per_image) -> dict[str, Metric]:
    """Return SSIM and its components by their names."""
    return {name: lambda a, b, name=name: getattr(per_image(a, b), name) for name in SSIM}


METRICS: Mapping[str, Metric] = {
    **ssim_metrics(),
    "psnr": psnr,
    "ssim-object": lambda a, b: scores(a, b)["ssim_object"],
    "silhouette-iou": silhouette_iou,
    "thin-recall": lambda a, b: thin_scores(a, b).recall,
    "thin-precision": lambda a, b: thin_scores(a, b).precision,
    **FURTHER_SCORES,
    FRECHET: frechet_distance,
    "fd-views": functools.partial(_between, "fd-views"),
    "fd-views-grey": functools.partial(_between, "fd-views-grey"),
    "lpips": _lpips,
    "fd-alexnet": functools.partial(_between, "fd-alexnet"),
    JUDGE: _code_lengths,
    "azimuth-error-deg": azimuth_error_deg,
    "elevation-error-deg": elevation_error_deg,
}
