"""Distances between sets of images, by features: a method's images and the true ones."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.analysis.intervals import clipped, jackknife_error, jackknife_interval
from bench.catalogue.methods import FLOOR, known_method
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
    """A distance, those without each block of objects [g], and whether it is a kernel distance."""

    value: float
    leave_one_out: Floats
    kernel: bool = False

    @property
    def interval(self) -> tuple[float, float]:
        """Return the 95 % interval over objects. A Fréchet distance is never below 0."""
        interval = jackknife_interval(self.value, [self.leave_one_out])
        return clipped(interval, (-np.inf if self.kernel else 0.0, np.inf))

    @property
    def debiased(self) -> float:
        """Return the distance of infinitely many objects, by the jackknife (Quenouille 1956).

        Extrapolated in 1 / g. NaN without an interval, and for a kernel's, which has no bias.
        """
        if self.kernel or jackknife_error([self.leave_one_out]) is None:
            return float("nan")
        count = len(self.leave_one_out)
        return float(count * self.value - (count - 1) * self.leave_one_out.mean())


class FeatureDistances:
    """The features of one extractor, as `bench.records.frames.Features`, with their distances.

    Tables, comparisons, the frontier and the report need the same distances, so each is computed
    once and kept. Features are read again: all of a run's would fill the memory.
    """

    def __init__(self, features: Features) -> None:
        self._features = features
        self._images: dict[CellKey, tuple[ImageKey, ...]] = {}
        self._sets: dict[tuple[ImageKey, ...], tuple[ImageKey, ...]] = {}  # alike in most cells
        self._distances: dict[tuple[CellKey, tuple[ImageKey, ...], bool], Distance] = {}
        self._truths: dict[Any, tuple[object, Any]] = {}

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

    def distance(self, cell: CellKey, images: Sequence[ImageKey], kernel: bool = False) -> Distance:
        """Return the distance between at least two images of a cell and the true ones.

        It is Fréchet's or, where `kernel`, that by kernels, for which all features of these images
        and of the true ones are in memory. Images that the method has not drawn are replaced by the
        blank ones. Raises KeyError for an image that neither has.
        """
        method, _, class_name = cell
        shown = tuple(images)
        shown = self._sets.setdefault(shown, shown)
        known = known_method(method)
        sees_cloud = known is None or known.sees_cloud  # else all conditions have the same images
        key = cell if sees_cloud else (method, "", class_name), shown, kernel
        if key not in self._distances:
            few = len({obj for obj, _ in shown}) <= EXACT_OBJECTS
            summary = _kernels if kernel else _moments if few else _grouped
            # Only the last of a kind is kept: the cells of a class follow each other.
            if self._truths.get(summary, (None,))[0] != (class_name, shown):
                truth = summary(self, (GROUND_TRUTH, "", class_name), shown)
                self._truths[summary] = (class_name, shown), truth
            drawn = summary(self, cell, shown)
            between = _BETWEEN[summary](drawn, self._truths[summary][1])
            self._distances[key] = Distance(*between, kernel)
        return self._distances[key]

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


def _moments(
    features: FeatureDistances, cell: CellKey, shown: Sequence[ImageKey]
) -> JackknifeMoments:
    return JackknifeMoments(features.filled(cell, shown), np.array([obj for obj, _ in shown]))


def _grouped(
    features: FeatureDistances, cell: CellKey, shown: Sequence[ImageKey]
) -> GroupedMoments:
    """Return the moments of many objects, of whose features ROWS are in memory at a time."""
    member, count = _blocks(shown)
    moments = GroupedMoments(count)
    for start in range(0, len(shown), ROWS):
        part = slice(start, start + ROWS)
        moments.add(features.filled(cell, shown[part]), member[part])
    return moments


def _kernels(features: FeatureDistances, cell: CellKey, shown: Sequence[ImageKey]) -> KernelSet:
    return KernelSet(features.filled(cell, shown), *_blocks(shown))


def _blocks(shown: Sequence[ImageKey]) -> tuple[NDArray[np.intp], int]:
    """Return the block of the object of each image [n], and the number of blocks."""
    objects = np.array([obj for obj, _ in shown])
    names, block = object_blocks(objects)
    return block[np.searchsorted(names, objects)], 1 + int(block.max())


def _between_moments(drawn: JackknifeMoments, truth: JackknifeMoments) -> tuple[float, Floats]:
    return centred_to_frechet(drawn.whole, truth.whole), left_out_distances(drawn, truth)


# The distance of two sets and those without each block, by what is kept of a set.
_BETWEEN: Mapping[Any, Callable[[Any, Any], tuple[float, Floats]]] = {
    _moments: _between_moments,
    _grouped: grouped_distances,
    _kernels: kernel_distances,
}
