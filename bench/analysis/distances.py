"""Distances between sets of images, by features: a method's images and the true ones."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Callable, Mapping, Sequence, Set
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.analysis.intervals import debiased, distance_interval, jackknife_interval
from bench.catalogue.methods import FLOOR, known_method
from bench.catalogue.metrics import KERNEL_METRICS
from bench.metrics.frechet import (
    EXACT_OBJECTS,
    GroupedMoments,
    JackknifeMoments,
    centred_to_frechet,
    grouped_distances,
    left_out_distances,
    object_blocks,
)
from bench.metrics.kernel_distance import KernelSet, kernel_distances
from bench.records.frames import Features, ImageKey
from bench.records.record import GROUND_TRUTH
from data_prep.arrays import Floats

CellKey = tuple[str, str, str]  # method, condition, class
ROWS = 4096  # features of many objects that are in memory at a time


class Distance(NamedTuple):
    """A distance, and the distances without each block of objects [g]."""

    value: float
    leave_one_out: Floats


class FeatureDistances:
    """The features of one extractor, as `bench.records.frames.Features`, with their distances.

    Tables, comparisons, the frontier and the report need the same distances, so each is computed
    once and kept. Features are read again: all of a run's would fill the memory.
    """

    def __init__(self, features: Features) -> None:
        self._features = features
        self._images: dict[CellKey, tuple[ImageKey, ...]] = {}
        self._sets: dict[tuple[ImageKey, ...], tuple[ImageKey, ...]] = {}  # alike in most cells
        self._distances: dict[tuple[CellKey, tuple[ImageKey, ...]], Distance] = {}
        self._truth: tuple[tuple[str, tuple[ImageKey, ...]], JackknifeMoments] | None = None
        self._true_groups: tuple[tuple[str, tuple[ImageKey, ...]], GroupedMoments] | None = None
        self._kernel_distances: dict[tuple[CellKey, tuple[ImageKey, ...]], Distance] = {}
        self._true_kernels: tuple[tuple[str, tuple[ImageKey, ...]], KernelSet] | None = None

    def images(self, method: str, condition: str, class_name: str) -> list[ImageKey]:
        """Return the images of a cell, sorted; none for a cell that the run does not have."""
        return list(self._known((method, condition, class_name)))

    def _known(self, cell: CellKey) -> tuple[ImageKey, ...]:
        if cell not in self._images:
            keys = tuple(self._features.images(*cell))
            self._images[cell] = self._sets.setdefault(keys, keys)
        return self._images[cell]

    def of(
        self, method: str, condition: str, class_name: str, images: Sequence[ImageKey]
    ) -> NDArray[Any]:
        """Return the features of `images`, [n, d]. Raises KeyError for an unknown image."""
        return self._features.of(method, condition, class_name, images)

    def distance(self, cell: CellKey, images: Sequence[ImageKey]) -> Distance:
        """Return the Fréchet distance between at least two images of a cell and the true ones.

        Images that the method has not drawn are replaced by the blank ones. Raises KeyError for an
        image that neither has. Only the features of this cell and of the truth are in memory.
        """
        key = self._key(cell, images)
        if key not in self._distances:
            _, shown = key
            names = {obj for obj, _ in shown}
            if len(names) <= EXACT_OBJECTS:
                self._distances[key] = self._leave_one_out(cell, shown)
            else:
                self._distances[key] = self._leave_groups_out(cell, shown, names)
        return self._distances[key]

    def _key(
        self, cell: CellKey, images: Sequence[ImageKey]
    ) -> tuple[CellKey, tuple[ImageKey, ...]]:
        """Return the key of the distance of images of a cell."""
        method, _, class_name = cell
        shown = tuple(images)
        shown = self._sets.setdefault(shown, shown)
        known = known_method(method)
        sees_cloud = known is None or known.sees_cloud  # else all conditions have the same images
        return (cell if sees_cloud else (method, "", class_name)), shown

    def _leave_one_out(self, cell: CellKey, shown: tuple[ImageKey, ...]) -> Distance:
        objects = np.array([obj for obj, _ in shown])
        truth = self._true_moments(cell[2], shown, objects)
        drawn = JackknifeMoments(self.filled(cell, shown), objects)
        value = centred_to_frechet(drawn.whole, truth.whole)
        return Distance(value, left_out_distances(drawn, truth))

    def _leave_groups_out(
        self, cell: CellKey, shown: tuple[ImageKey, ...], names: Set[str]
    ) -> Distance:
        """Return the distance of many objects, of whose features ROWS are in memory at a time."""
        key = cell[2], shown
        by_name, group = object_blocks(np.array(list(names)))
        group_of = dict(zip(by_name.tolist(), group.tolist(), strict=True))
        if self._true_groups is None or self._true_groups[0] != key:
            truth = self._grouped((GROUND_TRUTH, "", cell[2]), shown, group_of)
            self._true_groups = key, truth
        return Distance(
            *grouped_distances(self._grouped(cell, shown, group_of), self._true_groups[1])
        )

    def _grouped(
        self, cell: CellKey, shown: tuple[ImageKey, ...], group_of: Mapping[str, int]
    ) -> GroupedMoments:
        moments = GroupedMoments(1 + max(group_of.values()))
        for start in range(0, len(shown), ROWS):
            part = shown[start : start + ROWS]
            groups = np.array([group_of[obj] for obj, _ in part])
            moments.add(self.filled(cell, part), groups)
        return moments

    def _true_moments(
        self, class_name: str, shown: tuple[ImageKey, ...], objects: NDArray[Any]
    ) -> JackknifeMoments:
        # Only the last one is kept: the cells of a class follow each other.
        if self._truth is None or self._truth[0] != (class_name, shown):
            values = self._features.of(GROUND_TRUTH, "", class_name, shown)
            self._truth = (class_name, shown), JackknifeMoments(values, objects)
        return self._truth[1]

    def kernel_distance(self, cell: CellKey, images: Sequence[ImageKey]) -> Distance:
        """Return the kernel distance between images of a cell and the true ones, as `distance`.

        All features of these images and of the true ones are in memory.
        """
        key = self._key(cell, images)
        if key not in self._kernel_distances:
            _, shown = key
            names, block = object_blocks(np.array([obj for obj, _ in shown]))
            block_of = dict(zip(names.tolist(), block.tolist(), strict=True))
            member, count = np.array([block_of[obj] for obj, _ in shown]), 1 + int(block.max())
            drawn = KernelSet(self.filled(cell, shown), member, count)
            of_class = cell[2], shown
            if self._true_kernels is None or self._true_kernels[0] != of_class:
                true = self._features.of(GROUND_TRUTH, "", cell[2], shown)
                self._true_kernels = of_class, KernelSet(true, member, count)
            truth = self._true_kernels[1]
            self._kernel_distances[key] = Distance(*kernel_distances(drawn, truth))
        return self._kernel_distances[key]

    def filled(self, cell: CellKey, images: Sequence[ImageKey]) -> NDArray[Any]:
        """Return features [n, d] of images of a cell, with a blank image for each that it lacks."""
        known = self._known(cell)
        drawn = set(known[bisect_left(known, min(images)) : bisect_right(known, max(images))])
        is_drawn = np.array([image in drawn for image in images])
        if is_drawn.all():
            return self._features.of(*cell, images)
        missing = [image for image in images if image not in drawn]
        blank = self._features.of(FLOOR, *cell[1:], missing)
        values = np.empty((len(images), blank.shape[1]), blank.dtype)
        values[~is_drawn] = blank
        if is_drawn.any():
            values[is_drawn] = self._features.of(*cell, [i for i in images if i in drawn])
        return values


class SetDistance(NamedTuple):
    """A kind of distance between images of a cell and the true ones of the same views.

    between   returns the distance of some images of a cell by features
    interval  returns the 95 % interval from the distance and those without each block of objects
    debiased  returns the distance as it would be with infinitely many objects, from the same two
    """

    between: Callable[[FeatureDistances, CellKey, Sequence[ImageKey]], Distance]
    interval: Callable[[float, Floats], tuple[float, float]]
    debiased: Callable[[float, Floats], float]


def _unbiased(value: float, leave_one_out: Floats) -> float:
    """Return NaN: the estimate has no bias that the jackknife would take away."""
    del value, leave_one_out
    return float("nan")


FRECHET = SetDistance(FeatureDistances.distance, distance_interval, debiased)
KERNEL = SetDistance(
    FeatureDistances.kernel_distance,
    lambda value, leave_one_out: jackknife_interval(value, [leave_one_out]),
    _unbiased,
)


def set_distance(metric: str) -> SetDistance:
    """Return the kind of distance that a set metric is."""
    return KERNEL if metric in KERNEL_METRICS else FRECHET
