"""Fréchet distances between the images of a run and the true ones, each computed once.

Tables, comparisons, the frontier and the report need the same distances. They share the object that
belongs to the run, and keeps what it has computed; features are read again, not kept.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.catalogue.methods import FLOOR, known_method
from bench.metrics.frechet import JackknifeMoments, centred_to_frechet, left_out_distances
from bench.records.features import Features, ImageKey
from bench.records.record import GROUND_TRUTH
from data_prep.arrays import Floats

CellKey = tuple[str, str, str]  # method, condition, class


class Distance(NamedTuple):
    """A Fréchet distance, and the distances without each block of objects [g]."""

    value: float
    leave_one_out: Floats


def _sees_cloud(method: str) -> bool:
    """Whether the images of a method depend on the condition."""
    known = known_method(method)
    return known is None or known.sees_cloud


class FeatureDistances:
    """The features of one extractor, as `bench.records.features.Features`, with their distances."""

    def __init__(self, features: Features) -> None:
        self._features = features
        self._images: dict[CellKey, tuple[ImageKey, ...]] = {}
        self._sets: dict[tuple[ImageKey, ...], tuple[ImageKey, ...]] = {}  # alike in most cells
        self._known: dict[tuple[CellKey, tuple[ImageKey, ...]], Distance] = {}
        self._truth: tuple[tuple[str, tuple[ImageKey, ...]], JackknifeMoments] | None = None

    def images(self, method: str, condition: str, class_name: str) -> list[ImageKey]:
        """The images there are, sorted; none in a cell that is not there."""
        cell = method, condition, class_name
        if cell not in self._images:
            found = tuple(self._features.images(*cell))
            self._images[cell] = self._sets.setdefault(found, found)
        return list(self._images[cell])

    def of(
        self, method: str, condition: str, class_name: str, images: Sequence[ImageKey]
    ) -> NDArray[Any]:
        """Their features [n, d]. Raises KeyError for one that is not there."""
        return self._features.of(method, condition, class_name, images)

    def distance(self, cell: CellKey, images: Sequence[ImageKey]) -> Distance:
        """Between images of a cell, at least two, and the true ones of the same views.

        Those that the method has not drawn are replaced by the floor's. In memory are the features
        of this cell and of the true images. Raises KeyError for one that neither has drawn.
        """
        shown = tuple(images)
        shown = self._sets.setdefault(shown, shown)
        known = (cell if _sees_cloud(cell[0]) else (cell[0], "", cell[2])), shown
        if known not in self._known:
            objects = np.array([obj for obj, _ in shown])
            truth = self._true(cell[2], shown, objects)
            own = JackknifeMoments(self.filled(cell, shown), objects)
            value = centred_to_frechet(own.whole, truth.whole)
            self._known[known] = Distance(value, left_out_distances(own, truth))
        return self._known[known]

    def _true(
        self, class_name: str, shown: tuple[ImageKey, ...], objects: NDArray[Any]
    ) -> JackknifeMoments:
        """The last one is kept: the cells of a class follow each other."""
        if self._truth is None or self._truth[0] != (class_name, shown):
            values = self._features.of(GROUND_TRUTH, "", class_name, shown)
            self._truth = (class_name, shown), JackknifeMoments(values, objects)
        return self._truth[1]

    def filled(self, cell: CellKey, images: Sequence[ImageKey]) -> NDArray[Any]:
        """Features [n, d] of images of a cell; the floor's of those that it does not have."""
        drawn = set(self.images(*cell))
        own = np.array([image in drawn for image in images])
        if own.all():
            return self._features.of(*cell, images)
        lacking = [image for image in images if image not in drawn]
        floor = self._features.of(FLOOR, *cell[1:], lacking)
        values = np.empty((len(images), floor.shape[1]), floor.dtype)
        values[~own] = floor
        if own.any():
            there = [image for image in images if image in drawn]
            values[own] = self._features.of(*cell, there)
        return values
