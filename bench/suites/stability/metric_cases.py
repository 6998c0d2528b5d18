"""What a case on metrics is made of: two arrays, and what each metric has to make of them.

A metric is a function of two arrays: true pictures and pictures, two sets of features, the judge's
answers and the angles asked for. What a case states is a closed form, an independent computation,
an invariant or a named refusal; what nobody states is not asked.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from bench.catalogue.metrics import UNDEFINED
from bench.suites.stability.metric_tolerances import C1, CODE_LENGTH

Array = NDArray[Any]
Pair = tuple[Array, Array]
Number = float | Callable[[Any, Any], Any]  # or how to have it from the two arrays

SSIM = ("ssim", "luminance", "contrast", "structure")
THIN = ("thin-recall", "thin-precision")
FRECHET = "frechet-distance"
FD_VIEWS = ("fd-views", "fd-views-grey")  # Fréchet distances of networks' features


@dataclass(frozen=True)
class Near:
    """A stated value: a number, an array, or how to compute it; NaN stands for no value.

    words   where it comes from
    within  largest absolute difference; 0 is exact
    """

    words: str
    value: Number
    within: Number = 0.0


@dataclass(frozen=True)
class Refused:
    """A stated failure: the very type, and a part of the message."""

    error: type[Exception]
    says: str


Stated = Near | Refused


@dataclass(frozen=True)
class Case:
    """Two arrays, and what each metric makes of them."""

    id: str
    group: str
    given: Callable[[], Pair]
    stated: Mapping[str, Stated]


def twice(values: Array) -> Pair:
    """The same array two times."""
    return values, values.copy()


def ones(words: str, *metrics: str) -> dict[str, Stated]:
    """A score of exactly 1."""
    return {metric: Near(words, 1.0) for metric in metrics}


def undefined(*metrics: str) -> dict[str, Stated]:
    """No value, for the reason that the metric's row gives."""
    return {metric: Near(UNDEFINED[metric], math.nan) for metric in metrics}


def luminance_of_flat(p: int, q: int) -> float:
    """Luminance of two flat images."""
    return (2 * p * q + C1) / (p * p + q * q + C1)


WHOLE_LEG = ones("all of it, and nothing else, is drawn", *THIN)
UNIT_CODES = Near("a code of length 1, and finite angles", 1.0, CODE_LENGTH)
