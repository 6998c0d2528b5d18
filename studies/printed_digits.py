"""The digits that values of `results/docs` are printed with in the documentation.

The rule is that of tables (`bench.analysis.significant_digits`). A file with differences has the
number of objects of each line; in others it follows from the images of a line and the views of an
object.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cache

from bench.analysis.comparison import decimals
from bench.analysis.paper import AVERAGE
from bench.analysis.significant_digits import (
    Precision,
    RoundingErrors,
    precision,
    precision_of_difference,
)
from bench.catalogue.chosen import CHOSEN
from bench.catalogue.suites import SUITES

Line = Mapping[str, str]
OBJECTS = "objects"
# Files of runs with fewer views of an object than their suite has (`--views`).
VIEWS: Mapping[str, int] = {
    "costs.csv": 5,
    "learned-in-3d.csv": 4,
    "opponents-validation.csv": 4,
    "real-meshes-coloured.csv": 4,
    "real-meshes-grey.csv": 4,
}


def with_objects(lines: Iterable[Line], name: str) -> list[Line]:
    """Return the lines of a file with the number of objects of those that have images.

    An average over classes has the number of objects with which a mean over all of them would be
    moved as much: the harmonic mean over its classes, for each of them.
    """
    lines = list(lines)
    if not lines or OBJECTS in lines[0] or not {"n", "class"} <= lines[0].keys():
        return lines
    largest = max((int(line.get("views") or 0) for line in lines), default=0)
    result: list[Line] = []
    by_class: dict[tuple[str, ...], dict[str, float]] = {}
    for line in lines:
        objects = int(line["n"]) / (VIEWS.get(name) or largest or _suite_views()[line["suite"]])
        if line["class"] != AVERAGE:
            by_class.setdefault(_cell(line), {})[line["class"]] = objects
        result.append({**line, OBJECTS: f"{objects:g}"})
    for i, line in enumerate(result):
        if line["class"] == AVERAGE and (sizes := by_class.get(_cell(line))):
            alike = len(sizes) ** 2 / sum(1 / objects for objects in sizes.values())
            result[i] = {**line, OBJECTS: f"{alike:g}"}
    return result


def line_precision(line: Line, errors: RoundingErrors) -> Precision:
    """Return the digits of the value or the difference of a line that has its objects."""
    metric = line["metric"]
    sides = [
        (_number(line, value), _half(line, method, errors))
        for value, method in (
            (("value_a", "method_a"), ("value_b", "method_b"))
            if "difference" in line
            else (("value", "method"),)
        )
    ]
    if len(sides) == 2:
        return precision_of_difference(decimals(metric), sides)
    return precision(decimals(metric), *sides[0])


def _half(line: Line, method: str, errors: RoundingErrors) -> float:
    if not line.get(OBJECTS) or not line.get(method) or not line.get("condition"):
        return float("nan")
    name = line[method]
    if name in CHOSEN:  # the method of that row, which its note begins with
        name = line.get("note", "").partition("; ")[0]
    return errors.half_width(name, line["condition"], line["metric"], float(line[OBJECTS]))


def _number(line: Line, name: str) -> float:
    return float(line.get(name) or "nan")


def _cell(line: Line) -> tuple[str, ...]:
    return tuple(line.get(name, "") for name in ("suite", "method", "condition", "metric"))


@cache
def _suite_views() -> Mapping[str, int]:
    return {suite.id: suite.views for suite in SUITES}
