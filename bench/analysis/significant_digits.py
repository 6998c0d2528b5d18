"""The digits of a table value that survive rounding.

`results/rounding.csv` states how far random rounding moves the value of one object, by method,
condition and metric (suite `rounding`). The half width of the error of a table value is the one of
the centred normality hypothesis of Sohier, de Oliveira Castro, Févotte, Lathuilière, Petit and
Jamond, "Confidence Intervals for Stochastic Arithmetic", ACM TOMS 47(2), 2021: with the deviation
s of the value, known with k degrees of freedom,

    half = z((1 + PROBABILITY) / 2) * s * sqrt(k / chi2(1 - CONFIDENCE; k))

A digit survives where the error is below one unit of it. Nothing is known of a method, condition
or metric without a row, and its values are printed as they are.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

from bench.catalogue.lookup import family_of
from bench.catalogue.methods import has_papers_chain
from data_prep.failures import BadInput

ROUNDING_FILE = Path(__file__).resolve().parents[2] / "results" / "rounding.csv"
COLUMNS = (
    *("method", "condition", "metric", "value", "object_deviation", "degrees"),
    *("objects", "views", "repetitions"),
)
PROBABILITY = 0.95  # with which the error of a value is within its half width
CONFIDENCE = 0.95  # that the deviation is no larger than was taken
FILE_DECIMALS = 6  # of the values in the CSV files of tables
MOST_DIGITS = 6
NAN = float("nan")


class ObjectDeviation(NamedTuple):
    """The standard deviation that random rounding gives the value of one object.

    Attributes
    ----------
    deviation : float
        In units of the metric.
    degrees : float
        Degrees of freedom that it was measured with.
    """

    deviation: float
    degrees: float

    def half_width(self, objects: float = 1) -> float:
        """Return the half width of the error of a value over so many objects; NaN over none."""
        if not objects > 0:
            return NAN
        if self.deviation == 0:
            return 0.0
        return self.deviation * _half_widths(self.degrees) / math.sqrt(objects)


@cache
def _half_widths(degrees: float) -> float:
    """Return the half width for a deviation of 1, known with so many degrees of freedom."""
    from scipy.special import chdtri, ndtri  # `bench list` answers without it

    largest = math.sqrt(degrees / float(chdtri(degrees, CONFIDENCE)))
    return float(ndtri((1 + PROBABILITY) / 2)) * largest


class RoundingErrors:
    """The deviations that were measured, by method, condition and metric."""

    def __init__(self, deviations: Mapping[tuple[str, str, str], ObjectDeviation]) -> None:
        """Take the deviations."""
        self._deviations = dict(deviations)
        self._largest: dict[str, dict[str, ObjectDeviation]] = {}  # by metric and method
        for (method, _, metric), deviation in deviations.items():
            of_metric = self._largest.setdefault(metric, {})
            of_metric[method] = max(
                deviation, of_metric.get(method, deviation), key=ObjectDeviation.half_width
            )

    def half_width(self, method: str, condition: str, metric: str, objects: float) -> float:
        """Return the half width of the error of a table value over so many objects.

        It is that of the method at the condition; where that was not measured, the largest of the
        method over conditions; else the largest of the methods of its family, which are its
        variants, and for a method of the paper's chain the others of that chain. NaN where none
        of these is known.
        """
        deviation = self._deviations.get((method, condition, metric))
        if deviation is None:
            deviation = self._largest_of_family(method, metric)
        return NAN if deviation is None else deviation.half_width(objects)

    def _largest_of_family(self, method: str, metric: str) -> ObjectDeviation | None:
        of_metric = self._largest.get(metric, {})
        if method not in of_metric:
            related = [of_metric[other] for other in of_metric if _is_related(other, method)]
            if not related:
                return None
            of_metric[method] = max(related, key=ObjectDeviation.half_width)
        return of_metric[method]


def _is_related(other: str, method: str) -> bool:
    """Return whether two methods are variants of one, or both of the paper's chain."""
    return family_of(other) == family_of(method) or (
        has_papers_chain(other) and has_papers_chain(method)
    )


@cache
def rounding_errors(path: Path = ROUNDING_FILE) -> RoundingErrors:
    """Return the deviations in a file, which is read once; none where there is no file.

    Raises BadInput for a file that is not one of the suite `rounding`.
    """
    if not path.is_file():
        return RoundingErrors({})
    deviations = {}
    with path.open(encoding="utf-8", newline="") as file:
        reader = csv.DictReader(file)
        if missing := [name for name in COLUMNS[:6] if name not in (reader.fieldnames or ())]:
            raise BadInput(
                f"{path}: no column {', '.join(missing)}; copy it from 'tables/rounding.csv' of a "
                "run of the suite rounding"
            )
        for line in reader:
            try:
                measured = ObjectDeviation(float(line["object_deviation"]), float(line["degrees"]))
            except (TypeError, ValueError) as error:
                raise BadInput(f"{path}:{reader.line_num}: {error}; restore it with git") from error
            if not (measured.deviation >= 0 and (measured.degrees > 0 or measured.deviation == 0)):
                raise BadInput(
                    f"{path}:{reader.line_num}: a deviation of {measured.deviation:g} with "
                    f"{measured.degrees:g} degrees of freedom; restore it with git"
                )
            deviations[line["method"], line["condition"], line["metric"]] = measured
    return RoundingErrors(deviations)


def half_of_mean(halves: Sequence[float]) -> float:
    """Return the half width of a mean of values whose errors are independent; NaN for none."""
    return math.hypot(*halves) / len(halves) if halves else NAN


def surviving_decimals(half: float) -> int:
    """Return the decimals of the last digit that survives an error of a finite half width.

    0 for units, negative for tens; at most those of the files.
    """
    return FILE_DECIMALS if half == 0 else min(FILE_DECIMALS, math.floor(-math.log10(half)))


def significant_digits(value: float, half: float) -> int | None:
    """Return how many digits of a value survive, from its first that is not 0; None for unknown.

    At least 0, at most MOST_DIGITS.
    """
    if not (math.isfinite(value) and math.isfinite(half)):
        return None
    if value == 0:
        return MOST_DIGITS if half == 0 else 0
    digits = surviving_decimals(half) + math.floor(math.log10(abs(value))) + 1
    return min(MOST_DIGITS, max(0, digits))


class Precision(NamedTuple):
    """The digits that a value is printed with.

    Attributes
    ----------
    decimals : int
        Digits after the point.
    half : float or None
        Half width of the error by rounding where it takes digits away; None where all of them
        survive, and where nothing is known.
    """

    decimals: int
    half: float | None = None


def precision(declared: int, value: float, half: float) -> Precision:
    """Return the digits of a value that has `declared` decimals and an error by rounding.

    Its first digit is printed even where it does not survive, and never fewer than its units.
    """
    if not math.isfinite(half) or (survive := surviving_decimals(half)) >= declared:
        return Precision(declared)
    leading = -math.floor(math.log10(abs(value))) if value and math.isfinite(value) else 0
    decimals = min(declared, max(survive, leading, 0))
    return Precision(decimals, half)


def precision_of_difference(declared: int, sides: Iterable[tuple[float, float]]) -> Precision:
    """Return the digits of a difference, those of the coarser of its two (value, half width).

    So a difference has as many digits as the values that it is shown beside.
    """
    sides = list(sides)
    printed = [precision(declared, *side) for side in sides]
    moved = any(half is not None for _, half in printed)
    error = math.hypot(*(half for _, half in sides if math.isfinite(half)))
    return Precision(min(decimals for decimals, _ in printed), error if moved else None)
