"""Fréchet distances between the images of a run and the true ones, each computed once.

Tables, comparisons, the frontier and the report need the same distances. They share the object that
belongs to the run, and keeps what it has computed; features are read again, not kept.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.catalogue.methods import FLOOR
from bench.metrics.frechet import LeftOut, centred_to_frechet, left_out_distances
from bench.records.features import Features, Picture
from bench.records.record import GROUND_TRUTH

Floats = NDArray[np.float64]
CellKey = tuple[str, str, str]  # method, condition, class


class Distance(NamedTuple):
    """A Fréchet distance, and the distances without each block of objects [g]."""

    value: float
    left_out: Floats


class MeasuredFeatures:
    """The features of one extractor, as `bench.records.features.Features`, with their distances."""

    def __init__(self, features: Features) -> None:
        self._features = features
        self._pictures: dict[CellKey, tuple[Picture, ...]] = {}
        self._sets: dict[tuple[Picture, ...], tuple[Picture, ...]] = {}  # alike in most cells
        self._known: dict[tuple[CellKey, tuple[Picture, ...]], Distance] = {}
        self._truth: tuple[tuple[str, tuple[Picture, ...]], LeftOut] | None = None

    def pictures(self, method: str, condition: str, class_name: str) -> list[Picture]:
        """The images there are, sorted; none in a cell that is not there."""
        cell = method, condition, class_name
        if cell not in self._pictures:
            found = tuple(self._features.pictures(*cell))
            self._pictures[cell] = self._sets.setdefault(found, found)
        return list(self._pictures[cell])

    def of(
        self, method: str, condition: str, class_name: str, pictures: Sequence[Picture]
    ) -> NDArray[Any]:
        """Their features [n, d]. Raises KeyError for one that is not there."""
        return self._features.of(method, condition, class_name, pictures)

    def distance(self, cell: CellKey, pictures: Sequence[Picture]) -> Distance:
        """Between images of a cell, at least two, and the true ones of the same views.

        Those that the method has not drawn are replaced by the floor's. In memory are the features
        of this cell and of the true images. Raises KeyError for one that neither has drawn.
        """
        shown = tuple(pictures)
        shown = self._sets.setdefault(shown, shown)
        if (cell, shown) not in self._known:
            objects = np.array([obj for obj, _ in shown])
            truth = self._true(cell[2], shown, objects)
            own = LeftOut(self.filled(cell, shown), objects)
            value = centred_to_frechet(own.whole, truth.whole)
            self._known[cell, shown] = Distance(value, left_out_distances(own, truth))
        return self._known[cell, shown]

    def _true(self, class_name: str, shown: tuple[Picture, ...], objects: NDArray[Any]) -> LeftOut:
        """The last one is kept: the cells of a class follow each other."""
        if self._truth is None or self._truth[0] != (class_name, shown):
            values = self._features.of(GROUND_TRUTH, "", class_name, shown)
            self._truth = (class_name, shown), LeftOut(values, objects)
        return self._truth[1]

    def filled(self, cell: CellKey, pictures: Sequence[Picture]) -> NDArray[Any]:
        """Features [n, d] of images of a cell; the floor's of those that it does not have."""
        drawn = set(self.pictures(*cell))
        own = np.array([picture in drawn for picture in pictures])
        if own.all():
            return self._features.of(*cell, pictures)
        lacking = [picture for picture in pictures if picture not in drawn]
        floor = self._features.of(FLOOR, *cell[1:], lacking)
        values = np.empty((len(pictures), floor.shape[1]), floor.dtype)
        values[~own] = floor
        if own.any():
            there = [picture for picture in pictures if picture in drawn]
            values[own] = self._features.of(*cell, there)
        return values
