"""The scores of a run's images, summed over the views of each object.

Means over objects and numbers of images follow from these sums, so that no table needs the images
themselves: memory grows with objects times cells. A run that goes on is summed by the same code as
a finished one, and gives the same values to the last digit.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench.analysis.cells import CellKey, cells
from bench.catalogue.methods import FLOOR
from bench.catalogue.metrics import IMAGE_METRICS, METRICS, column
from bench.records.parquet import read_batches
from bench.records.record import TIMES, Record
from data_prep.arrays import Floats
from data_prep.failures import BadInput

KEY = ("method", "condition", "class", "object")
ONE = np.uint16(1)  # of the type of the counts: a number of another takes 30 times as long to add
VIEWS = 2**16  # more than an object can have: numbers of its images are uint16


class _Tally:
    """Sums and numbers of values at places, [n] each."""

    def __init__(self, size: int) -> None:
        self.sums, self.counts = np.zeros(size), np.zeros(size, np.uint16)

    def add(self, places: NDArray[np.int64], values: Floats) -> None:
        """Add values [k] at places [k]; NaN is no value."""
        known = ~np.isnan(values)
        # One after the other, unlike `bincount` batch by batch: equal images have equal sums to the
        # last bit wherever a batch ends, and the difference of their methods is 0.
        np.add.at(self.sums, places[known], values[known])
        np.add.at(self.counts, places[known], ONE)


class ObjectSums:
    """The images of the objects of a run in all cells: their numbers, and the sums of their scores.

    A failed image has the scores of the blank image of the same view and condition, in sums of
    their own.

    Attributes
    ----------
    metrics : list of str
        Metrics of images that have sums.
    reasons : dict
        Number of failed images by cell and reason.
    """

    def __init__(
        self,
        methods: Sequence[str],
        conditions: Sequence[str],
        objects: Iterable[str],
        metrics: Iterable[str],
    ) -> None:
        """Take the names of a run as its manifest has them; objects are "class/name"."""
        named = (name.partition("/") for name in objects)
        self._names = sorted((class_name, name) for class_name, _, name in named)
        self._objects = {name: place for place, name in enumerate(self._names)}
        self._of_class: dict[str, slice] = {}
        for place, (class_name, _) in enumerate(self._names):
            start = self._of_class.get(class_name, slice(place, place)).start
            self._of_class[class_name] = slice(start, place + 1)
        self._methods = {name: place for place, name in enumerate(methods)}
        self._conditions = {name: place for place, name in enumerate(conditions)}
        self._shape = len(self._methods), len(self._conditions), len(self._names)
        self._planned, self._drawn = (np.zeros(np.prod(self._shape), np.uint16) for _ in range(2))
        self._scores: dict[str, _Tally] = {}
        self._blanks: dict[str, _Tally] = {}
        self._missing = np.empty((2, 0), np.int64)  # numbers of images and their places
        self.reasons: dict[CellKey, Counter[str]] = {}
        self.metrics: list[str] = []
        for metric in (*metrics, *TIMES):  # which are summed as scores are
            self._begin(metric)
        self.metrics = [metric for metric in self.metrics if metric not in TIMES]

    def _begin(self, metric: str) -> None:
        self.metrics.append(metric)
        for tallies in (self._scores, self._blanks):
            # Zeros that no image is added to take no memory.
            tallies[column(metric)] = _Tally(int(np.prod(self._shape)))

    @property
    def columns(self) -> list[str]:
        """Return the columns of the records that are added."""
        return [*KEY, "view", "outcome", "reason", *self._scores]

    def add(self, records: pd.DataFrame) -> None:
        """Add images; those of an object in the order of their views.

        Raises BadInput for a name that the run does not have.
        """
        places, exists = self._places(records), (records["outcome"] == "ok").to_numpy()
        np.add.at(self._planned, places, ONE)
        drawn = places[exists]
        np.add.at(self._drawn, drawn, ONE)
        for name, tally in self._scores.items():
            values = records[name].to_numpy(np.float64)
            if name in TIMES:  # failed images have times, too
                tally.add(places, values)
            else:
                tally.add(drawn, values[exists])
        failed = (records["outcome"] == "failed").to_numpy()
        if failed.any():
            lost, at = records[failed], places[failed]
            missing = np.concatenate([self._missing, [self._images(lost, at), at]], axis=1)
            self._missing = missing[:, np.argsort(missing[0], kind="stable")]
            for cell, group in cells(lost):
                self.reasons.setdefault(cell, Counter()).update(group["reason"])

    def add_blanks(self, records: pd.DataFrame, names: Iterable[str] | None = None) -> None:
        """Put the blank images among some records in place of failed ones.

        All images have been added before. `names` are the columns whose scores are added, by
        default all.
        """
        blank = records[(records["method"] == FLOOR) & (records["outcome"] == "ok")]
        if blank.empty or not self._missing.size:
            return
        images = self._images(blank, self._places(blank))
        order = np.argsort(images, kind="stable")
        images = images[order]
        first, last = np.searchsorted(self._missing[0], [images[0], images[-1] + 1])
        missing, places = self._missing[:, first:last]
        rows = np.searchsorted(images, missing)
        known = images[rows] == missing
        for name in self._scores if names is None else names:
            values = blank[name].to_numpy(np.float64)[order[rows[known]]]
            self._blanks[name].add(places[known], values)

    def add_object(self, records: Sequence[Record]) -> None:
        """Add all images of an object of a run that goes on."""
        fields = {name: "class_name" if name == "class" else name for name in self.columns}
        frame = pd.DataFrame(
            {name: [getattr(record, field) for record in records] for name, field in fields.items()}
        )
        self.add(frame)
        self.add_blanks(frame)
        self._missing = self._missing[:, :0]

    def add_metric(self, metric: str, records: Iterable[pd.DataFrame]) -> None:
        """Add the scores by another metric of images that exist and have been added."""
        self._begin(metric)
        for part in records:
            values = part[column(metric)].to_numpy(np.float64)
            self._scores[column(metric)].add(self._places(part), values)
            self.add_blanks(part.assign(outcome="ok"), [column(metric)])

    def _places(self, records: pd.DataFrame) -> NDArray[np.int64]:
        """Return the places of method, condition and object of each record."""
        coded = {name: pd.factorize(records[name]) for name in KEY}
        of_class, classes = coded["class"]
        of_object, names = coded["object"]
        pairs, both = pd.factorize(of_class.astype(np.int64) * len(names) + of_object)
        objects = [
            (classes[pair // len(names)], names[pair % len(names)]) for pair in both.tolist()
        ]
        places = np.zeros(len(records), np.int64)
        parts: list[tuple[NDArray[Any], Iterable[Any], Mapping[Any, int]]] = [
            (*coded["method"], self._methods),
            (*coded["condition"], self._conditions),
            (pairs, objects, self._objects),
        ]
        for codes, values, known in parts:
            if unknown := [value for value in values if value not in known]:
                raise BadInput(
                    f"records of {unknown[0]}, which the manifest does not have; start the run "
                    "again with its command"
                )
            numbers = np.array([known[value] for value in values], np.int64)
            places = places * len(known) + numbers[codes]
        return places

    def _images(self, records: pd.DataFrame, places: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return a number for the condition, object and view of each record."""
        _, conditions, objects = self._shape
        return places % (conditions * objects) * VIEWS + records["view"].to_numpy(np.int64)

    def _at(self, cell: CellKey) -> slice:
        method, condition, class_name = cell
        row = self._methods[method] * self._shape[1] + self._conditions[condition]
        of_class = self._of_class[class_name]
        return slice(row * self._shape[2] + of_class.start, row * self._shape[2] + of_class.stop)

    @property
    def cells(self) -> list[CellKey]:
        """Return the cells that have been added, by condition, method and class."""
        every = (
            (method, condition, class_name)
            for condition in self._conditions
            for method in self._methods
            for class_name in self._of_class
        )
        return [cell for cell in every if self._planned[self._at(cell)].any()]

    @property
    def objects_of(self) -> dict[str, int]:
        """Return the number of objects that have been added by class."""
        added = self._planned.reshape(-1, self._shape[2]).max(axis=0) > 0
        counts = {name: int(added[part].sum()) for name, part in self._of_class.items()}
        return {name: count for name, count in counts.items() if count}

    def objects(self, class_name: str) -> NDArray[Any]:
        """Return the names of the objects of a class, sorted, [G]."""
        return np.array([name for _, name in self._names[self._of_class[class_name]]], object)

    def numbers(self, cell: CellKey) -> tuple[NDArray[np.uint16], NDArray[np.uint16]]:
        """Return how many images of each object of a cell exist, and how many should, [G]."""
        at = self._at(cell)
        return self._drawn[at], self._planned[at]

    def images(self, cell: CellKey) -> tuple[int, int]:
        """Return how many images of a cell exist, and how many should."""
        drawn, planned = self.numbers(cell)
        return int(drawn.sum()), int(planned.sum())

    def per_object(self, cell: CellKey, metric: str, blanks: bool = False) -> Floats:
        """Return the mean score of each object of a cell, [G]; NaN where no image has one.

        With `blanks` those in place of failed images count, too. Times are metrics of
        this, by their columns.
        """
        at, scores, blank = self._at(cell), *self._tallies(metric)
        sums, counts = scores.sums[at], scores.counts[at]
        if blanks:
            sums, counts = sums + blank.sums[at], counts + blank.counts[at]
        return np.divide(sums, counts, out=np.full(len(sums), np.nan), where=counts > 0)

    def totals(self, cell: CellKey, metric: str, blanks: bool = False) -> tuple[float, int]:
        """Return the sum and the number of the scores of a cell, or of the blanks in it."""
        at, tally = self._at(cell), self._tallies(metric)[blanks]
        return float(tally.sums[at].sum()), int(tally.counts[at].sum())

    def _tallies(self, metric: str) -> tuple[_Tally, _Tally]:
        return self._scores[column(metric)], self._blanks[column(metric)]

    def unmeasured(self, reasons: Mapping[str, str]) -> dict[str, str]:
        """Return why metrics by a network have no value at all, where images exist.

        `reasons` are those of extractors that a run does not have.
        """
        if not self._drawn.any():
            return {}
        return {
            metric: reasons.get(extractor, f"skipped: {extractor} is not measured")
            for metric in set(IMAGE_METRICS).intersection(self.metrics)
            if (extractor := METRICS[metric].extractor)
            and not self._tallies(metric)[0].counts.any()
        }


def sum_records(directory: Path, manifest: Mapping[str, Any]) -> ObjectSums:
    """Return the sums of the records of a run, which are read part by part.

    Raises BadInput where they cannot be read, and where the manifest does not describe them.
    """
    names = manifest["methods"], manifest["conditions"], manifest["objects"]
    sums = ObjectSums(*names, IMAGE_METRICS)
    for part in read_batches(directory, sums.columns):
        sums.add(part)
    if sums.reasons:
        for part in read_batches(directory, sums.columns, method=FLOOR):
            sums.add_blanks(part)
    return sums
