"""The parts of a case on metrics, the images of cases, and the tolerances of values.

A metric is a function of two arrays: true images and images, two sets of features, the judge's
answers and the true angles. A case expects a closed form, an independent computation, an invariant
or a named refusal; it is measured by the metrics that it has an expectation of, and no others.

Tolerances, with u = 2^-53:

* `SUMS`. The mean over the 118 x 118 windows of three channels is taken tile by tile: sums of at
  most 576 x 3 values of at most 1, and of 25 tiles. Off by 1,753 u at most: 2e-13.
* `DECIBELS`. The sum of squares is exact; a quotient, a logarithm and a product round values of at
  most 96 dB: by 5 u of that, and the closed form by as much. 1e-12 is nine times both.
* `ONE_WINDOW`. A moment of one window of noise is a sum of 11 sums of 11 products of at most 255^2,
  off by 22 u of that. Four moments, over the least of the divisors, C3: 2e-11.
* `ROUNDING`. A singular value errs by a few u of the largest one, the sum of d of them by d u of
  the traces: 5e-13 of the traces for d = 2,048. The distance is the difference of traces.
* Features that are off by at most e move the root of the distance by at most
  D = e sqrt(d n / (n - 1)) a set: it is a metric, and pairing each row with itself is one way to
  carry one Gaussian to the other (Gelbrich 1990). The distance itself moves by 2 D times its root
  and D^2.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.catalogue.metrics import UNDEFINED
from data_prep.arrays import Floats
from data_prep.scene import IMAGE_SIZE, UInt8Images

Array = NDArray[Any]

# Written out from the protocol, not imported from `bench.metrics.structural_similarity`, whose
# constants are under test.
WINDOW, SIGMA = 11, 1.5
C1, C2, C3 = 2.55**2, 7.65**2, 7.65**2 / 2
U = 2.0**-53
SUMS = (576 * 3 + 25) * U
ONE_WINDOW = 4 * 22 * U * 255**2 / C3
ROUNDING = 1e-12
DECIBELS = 1e-12
FLOAT32_FEATURES = 1e-4  # sums of up to 864 float32 products a layer, of features up to some 10
CODE_LENGTH = 18 * 2.0**-24  # float32: half of the 32 roundings of a sum of squares, root, quotient
ANGLE_DEG = math.degrees(2.0**-23)  # sine and cosine in float32


def trace(x: Floats) -> Any:
    """Return the trace of the covariance, in two passes."""
    return ((x - x.mean(axis=0)) ** 2).sum() / (len(x) - 1)


def rounding(x: Array, y: Array) -> float:
    """Return ROUNDING of the traces and of the squared shift of two sets of features."""
    x, y = x.astype(np.float64), y.astype(np.float64)
    shift = x.mean(axis=0) - y.mean(axis=0)
    return ROUNDING * float(trace(x) + trace(y) + shift @ shift)


def largest_move(root: Any, features: int, rows: int, by: float) -> float:
    """Return the largest move of a distance where both sets of features are off by `by`.

    The derivation is in the module's docstring.
    """
    move = 2 * by * math.sqrt(features * rows / (rows - 1))
    return float(2 * root * move + move**2)


ArrayPair = tuple[Array, Array]
Number = float | Callable[[Any, Any], Any]  # or its computation from the two arrays

SSIM = ("ssim", "luminance", "contrast", "structure")
THIN = ("thin-recall", "thin-precision")
FRECHET = "frechet-distance"
FD_VIEWS = ("fd-views", "fd-views-grey")  # Fréchet distances of networks' features


@dataclass(frozen=True)
class Near:
    """An expected value: a number, an array, or its computation; NaN stands for no value.

    words   its origin
    within  largest absolute difference; 0 is exact
    """

    words: str
    value: Number
    within: Number = 0.0


@dataclass(frozen=True)
class Refused:
    """An expected failure: the exact type, and a part of the message."""

    error: type[Exception]
    says: str


MetricExpectation = Near | Refused


@dataclass(frozen=True)
class MetricCase:
    """The two arrays of a case, and the expected result of each metric."""

    id: str
    group: str
    given: Callable[[], ArrayPair]
    stated: Mapping[str, MetricExpectation]


Given = Callable[[], ArrayPair]


def cases(
    group: str, *rows: tuple[str, Given, Mapping[str, MetricExpectation]]
) -> tuple[MetricCase, ...]:
    """Return the cases of a group, a row each: id, arrays, and the expectation by metric."""
    return tuple(MetricCase(case_id, group, given, stated) for case_id, given, stated in rows)


def cases_of(
    metric: str, group: str, *rows: tuple[str, Given, MetricExpectation]
) -> tuple[MetricCase, ...]:
    """Return cases of a group about one metric, a row each: id, arrays, and expectation."""
    return cases(group, *((case_id, given, {metric: stated}) for case_id, given, stated in rows))


def near(
    words: str, value: Number, *metrics: str, within: Number = 0.0
) -> dict[str, MetricExpectation]:
    """Return the same value for several metrics."""
    return {metric: Near(words, value, within) for metric in metrics}


def refused(
    says: str, *metrics: str, error: type[Exception] = ValueError
) -> dict[str, MetricExpectation]:
    """Return the same failure for several metrics."""
    return {metric: Refused(error, says) for metric in metrics}


def undefined(*metrics: str) -> dict[str, MetricExpectation]:
    """Return no value, for the reason that the metric's row gives."""
    return {metric: Near(UNDEFINED[metric], math.nan) for metric in metrics}


def luminance_of_flat(p: int, q: int) -> float:
    """Return the luminance of two flat images."""
    return (2 * p * q + C1) / (p * p + q * q + C1)


def decibels(squares: float, side: int = IMAGE_SIZE) -> float:
    """Return PSNR of square images with this sum of squared differences.

    The sum of identical images counts as 1.
    """
    return 20 * math.log10(255) - 10 * math.log10(max(squares, 1) / (side * side * 3))


def twice(values: Array) -> ArrayPair:
    """Return the same array two times."""
    return values, values.copy()


UNIT_CODES = Near("a code of length 1, and finite angles", 1.0, CODE_LENGTH)


def flat(level: int, count: int = 1, side: int = IMAGE_SIZE) -> UInt8Images:
    """Return images with every pixel of one level."""
    return np.full((count, side, side, 3), level, np.uint8)


def noise(seed: int, side: int = IMAGE_SIZE, count: int = 1) -> UInt8Images:
    """Return independent levels, all 256 as likely."""
    rng = np.random.default_rng(seed)
    return rng.integers(0, 256, (count, side, side, 3), dtype=np.uint8)


def speck(background: int, level: int, at: int) -> UInt8Images:
    """Return a flat image with one pixel of another level.

    The pixel (64, 64) is in 121 windows of SSIM, the corner (0, 0) in one.
    """
    return _painted(flat(background), slice(at, at + 1), slice(at, at + 1), level)


def leg(
    level: int = 80, rows: slice = slice(40, 80), columns: slice = slice(60, 63)
) -> UInt8Images:
    """Return a bar of 40 x 3 px on white, all of it thin."""
    return _painted(flat(255), rows, columns, level)


def boxes(count: int = 6) -> UInt8Images:
    """Return coloured boxes of different sizes on white, as input of the networks."""
    rng = np.random.default_rng(0)
    images = flat(255, count)
    for image in images:
        top, left, height, width = rng.integers(10, 60, 4)
        image[top : top + height, left : left + width] = rng.integers(0, 255, 3)
    return images


def grey(images: UInt8Images) -> UInt8Images:
    """Return luma (Rec. 601), rounded half up, in three channels."""
    luma = np.floor((images @ np.array([299.0, 587.0, 114.0]) + 500) / 1000)
    return np.repeat(luma.astype(np.uint8)[..., None], 3, axis=-1)


def _painted(image: UInt8Images, rows: slice, columns: slice, level: int) -> UInt8Images:
    image = image.copy()
    image[:, rows, columns] = level
    return image
