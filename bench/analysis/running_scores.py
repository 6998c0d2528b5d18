"""Image scores of a run that goes on, from sums that objects are added to.

In memory is a mean for each object, cell and metric, and never a record.
"""

from __future__ import annotations

import math
from array import array
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from bench.analysis.cells import CellKey
from bench.analysis.comparison import NAN, Estimate
from bench.analysis.intervals import clipped, mean_interval
from bench.analysis.scores import CellValue, RowWithSamples, quality_row
from bench.catalogue.methods import FLOOR
from bench.catalogue.metrics import UNDEFINED, column, value_range
from bench.records.record import Record


@dataclass
class _MetricSums:
    """The scores of a cell by one metric.

    drawn, blank  number and sum of the scores of existing images, and of the blank ones in place of
                  failed ones
    per_object    the mean of each object that has one
    """

    drawn: list[float] = field(default_factory=lambda: [0, 0.0])
    blank: list[float] = field(default_factory=lambda: [0, 0.0])
    per_object: array[float] = field(default_factory=lambda: array("d"))


class _CellSums:
    """The images of a method under a condition, of a class."""

    def __init__(self, metrics: Sequence[str]) -> None:
        self.images, self.drawn = 0, 0
        self.reasons: Counter[str] = Counter()
        self.metrics = {metric: _MetricSums() for metric in metrics}

    def add(self, records: Sequence[Record], blanks: Mapping[int, Record]) -> None:
        """Add the images of an object; `blanks` are the blank ones by view."""
        drawn = [record for record in records if record.outcome == "ok"]
        failed = [record for record in records if record.outcome == "failed"]
        self.images += len(records)
        self.drawn += len(drawn)
        self.reasons.update(record.reason for record in failed)
        stand_ins = [blanks[record.view] for record in failed if record.view in blanks]
        for metric, sums in self.metrics.items():
            scores = _scores(drawn, metric)
            for total, values in ((sums.drawn, scores), (sums.blank, _scores(stand_ins, metric))):
                total[0] += len(values)
                total[1] += sum(values)
            if scores:
                sums.per_object.append(sum(scores) / len(scores))

    def value(self, metric: str) -> CellValue:
        """Return the value by a metric."""
        sums = self.metrics[metric]
        per_object = np.array(sums.per_object)
        interval = clipped(mean_interval(per_object), value_range(metric))
        both = [a + b for a, b in zip(sums.drawn, sums.blank, strict=True)]
        undefined = self.drawn - int(sums.drawn[0]) if metric in UNDEFINED else 0
        return CellValue(
            Estimate(_mean(sums.drawn), *interval), _mean(both), per_object, undefined=undefined
        )


class RunningScores:
    """The image scores of the objects of a run that have been added."""

    def __init__(self, suite: str, metrics: Sequence[str]) -> None:
        """Take the id of the suite, and metrics of images."""
        self.objects = 0
        self._suite, self._metrics = suite, tuple(metrics)
        self._cells: dict[CellKey, _CellSums] = {}

    def add(self, records: Iterable[Record]) -> None:
        """Add all records of one object."""
        self.objects += 1
        of_cell: dict[CellKey, list[Record]] = {}
        for record in records:
            cell = record.method, record.condition, record.class_name
            of_cell.setdefault(cell, []).append(record)
        for cell, of_object in of_cell.items():
            blanks = of_cell.get((FLOOR, *cell[1:]), ())
            by_view = {record.view: record for record in blanks if record.outcome == "ok"}
            self._cells.setdefault(cell, _CellSums(self._metrics)).add(of_object, by_view)

    def rows(
        self, methods: Sequence[str], conditions: Sequence[str], skipped: Mapping[str, str]
    ) -> list[RowWithSamples]:
        """Return the rows of all cells, as `bench.analysis.scores.image_rows` does of a whole run.

        `skipped` has the reasons for metrics that were not measured.
        """

        def place(cell: CellKey) -> tuple[int, int, str]:
            method, condition, class_name = cell
            return conditions.index(condition), methods.index(method), class_name

        rows = []
        for cell in sorted(self._cells, key=place):
            sums = self._cells[cell]
            for metric in self._metrics:
                reason = skipped.get(metric)
                value = CellValue(note=reason) if reason else sums.value(metric)
                images = sums.drawn, sums.images
                rows.append(quality_row(self._suite, cell, metric, images, sums.reasons, value))
        return rows

    def has_values(self, metric: str) -> bool:
        """Return whether any image has a score by a metric."""
        return any(sums.metrics[metric].drawn[0] for sums in self._cells.values())


def _scores(records: Iterable[Record], metric: str) -> list[float]:
    """Return the scores of the images that have one."""
    values = (getattr(record, column(metric)) for record in records)
    return [value for value in values if value is not None and not math.isnan(value)]


def _mean(total: Sequence[float]) -> float:
    count, sum_ = total
    return sum_ / count if count else NAN
