"""Statistics of sets of images by their features: distances, and what networks recognise in them.

The judge (`bench.judges.judge`) gives the direction of view and a shape code from an image alone: a
method that ignores its cloud, or the view, may have a good SSIM, but is recognised here.
"""

from __future__ import annotations

import json
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from safetensors import safe_open

from bench.analysis.intervals import clipped, jackknife_error, jackknife_interval
from bench.catalogue.methods import FLOOR, known_method
from bench.catalogue.metrics import RECOGNITION_METRICS, column
from bench.judges.answers import VIEW_COLUMNS, Gallery, gallery
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
from bench.records.job import GROUND_TRUTH
from data_prep.arrays import Floats
from data_prep.failures import BadInput

# Method, condition and class: the images of a method that one value is computed from.
ImageSet = tuple[str, str, str]
FEATURES_AT_ONCE = 4096  # images whose features are in memory at a time, where there are many


class Distance(NamedTuple):
    """A distance between two sets of images, with its leave-one-out values.

    leave_one_out  the distances [g] of all images but those of one block of objects
    kernel         whether it is a kernel distance, else a Fréchet distance
    """

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
        """Return the distance without the bias of few objects, by the jackknife (Quenouille 1956).

        It is extrapolated in 1 / g to infinitely many blocks. NaN where the distance has no
        interval, and for a kernel distance, which has no bias.
        """
        if self.kernel or jackknife_error([self.leave_one_out]) is None:
            return float("nan")
        count = len(self.leave_one_out)
        return float(count * self.value - (count - 1) * self.leave_one_out.mean())


class FeatureDistances:
    """The features of one extractor, as `bench.records.frames.Features`, with their distances.

    Tables, comparisons, the frontier and the report need the same distances, so each is computed
    once and kept. Features are not kept, but read again: those of a whole run would fill the
    memory.
    """

    def __init__(self, features: Features) -> None:
        self._features = features
        self._images: dict[ImageSet, tuple[ImageKey, ...]] = {}
        # Most methods have images of the same objects and views: equal tuples are kept once.
        self._shared: dict[tuple[ImageKey, ...], tuple[ImageKey, ...]] = {}
        self._distances: dict[tuple[ImageSet, tuple[ImageKey, ...], bool], Distance] = {}
        # By summary function, the class and images of the last true images, and their summary.
        self._truths: dict[Any, tuple[object, Any]] = {}

    def images(self, method: str, condition: str, class_name: str) -> list[ImageKey]:
        """Return the images that have features, sorted; none for a set that the run lacks."""
        return list(self._known((method, condition, class_name)))

    def _known(self, image_set: ImageSet) -> tuple[ImageKey, ...]:
        if image_set not in self._images:
            keys = tuple(self._features.images(*image_set))
            self._images[image_set] = self._shared.setdefault(keys, keys)
        return self._images[image_set]

    def of(
        self, method: str, condition: str, class_name: str, images: Sequence[ImageKey]
    ) -> NDArray[Any]:
        """Return the features of `images`, [n, d]. Raises KeyError for an unknown image."""
        return self._features.of(method, condition, class_name, images)

    def distance(
        self, image_set: ImageSet, images: Sequence[ImageKey], kernel: bool = False
    ) -> Distance:
        """Return the distance between at least two images of a method and the true ones.

        It is Fréchet's or, with `kernel`, the kernel distance, for which the features of all these
        images and of the true ones are in memory. An image that the method has not drawn is
        replaced by the blank one. Raises KeyError for an image that neither has.
        """
        method, _, class_name = image_set
        shown = tuple(images)
        shown = self._shared.setdefault(shown, shown)
        known = known_method(method)
        sees_cloud = known is None or known.sees_cloud
        # A method that sees no cloud has the same images under all conditions.
        drawn_by = image_set if sees_cloud else (method, "", class_name)
        key = drawn_by, shown, kernel
        if key not in self._distances:
            between, summary = _distance_functions(kernel, len({obj for obj, _ in shown}))
            truth = self._summary_of_truth(summary, class_name, shown)
            value, leave_one_out = between(summary(self, image_set, shown), truth)
            self._distances[key] = Distance(value, leave_one_out, kernel)
        return self._distances[key]

    def _summary_of_truth(
        self,
        summary: Callable[[FeatureDistances, ImageSet, Sequence[ImageKey]], Any],
        class_name: str,
        shown: tuple[ImageKey, ...],
    ) -> Any:
        """Return the summary of true images; the last of each kind is kept for the next method."""
        known, truth = self._truths.get(summary, (None, None))
        if known != (class_name, shown):
            truth = summary(self, (GROUND_TRUTH, "", class_name), shown)
            self._truths[summary] = (class_name, shown), truth
        return truth

    def filled(self, image_set: ImageSet, images: Sequence[ImageKey]) -> NDArray[Any]:
        """Return features [n, d] of images, with a blank image for each that was not drawn."""
        known = self._known(image_set)
        drawn = set(known[bisect_left(known, min(images)) : bisect_right(known, max(images))])
        is_drawn = np.array([image in drawn for image in images])
        if is_drawn.all():
            return self._features.of(*image_set, images)
        missing = [image for image in images if image not in drawn]
        blank = self._features.of(FLOOR, *image_set[1:], missing)
        values = np.empty((len(images), blank.shape[1]), blank.dtype)
        values[~is_drawn] = blank
        if is_drawn.any():
            existing = [image for image in images if image in drawn]
            values[is_drawn] = self._features.of(*image_set, existing)
        return values


def _moments(
    features: FeatureDistances, image_set: ImageSet, shown: Sequence[ImageKey]
) -> JackknifeMoments:
    return JackknifeMoments(features.filled(image_set, shown), np.array([obj for obj, _ in shown]))


def _grouped(
    features: FeatureDistances, image_set: ImageSet, shown: Sequence[ImageKey]
) -> GroupedMoments:
    """Return the moments of many objects, whose features are read in parts."""
    member, count = _blocks(shown)
    moments = GroupedMoments(count)
    for start in range(0, len(shown), FEATURES_AT_ONCE):
        part = slice(start, start + FEATURES_AT_ONCE)
        moments.add(features.filled(image_set, shown[part]), member[part])
    return moments


def _kernels(
    features: FeatureDistances, image_set: ImageSet, shown: Sequence[ImageKey]
) -> KernelSet:
    return KernelSet(features.filled(image_set, shown), *_blocks(shown))


def _blocks(shown: Sequence[ImageKey]) -> tuple[NDArray[np.intp], int]:
    """Return for each image [n] the block that its object is in, and the number of blocks."""
    objects = np.array([obj for obj, _ in shown])
    names, block = object_blocks(objects)
    return block[np.searchsorted(names, objects)], 1 + int(block.max())


def _between_moments(drawn: JackknifeMoments, truth: JackknifeMoments) -> tuple[float, Floats]:
    return centred_to_frechet(drawn.whole, truth.whole), left_out_distances(drawn, truth)


def _distance_functions(
    kernel: bool, objects: int
) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """Return the distance between two summaries of image sets, and the function that summarises.

    The first also returns the distance without each block of objects. Fréchet distances of many
    objects leave out blocks of objects instead of single ones.
    """
    if kernel:
        return kernel_distances, _kernels
    if objects <= EXACT_OBJECTS:
        return _between_moments, _moments
    return grouped_distances, _grouped


def true_gallery(answers: Features, class_name: str) -> Gallery:
    """Return the gallery of a class: the judge's answers to the true images of a run."""
    truth = (GROUND_TRUTH, "", class_name)
    images = answers.images(*truth)
    codes = answers.of(*truth, images) if images else np.empty((0, VIEW_COLUMNS))
    return gallery(class_name, images, codes)


@dataclass(frozen=True, eq=False)
class ClassHead:
    """The layer that predicts the class from features of length d.

    classes  the C classes, in the order of the rows
    weight   float64 [C, d]
    bias     float64 [C]
    """

    classes: tuple[str, ...]
    weight: Floats
    bias: Floats

    def confidence(self, features: NDArray[Any], class_name: str) -> Floats:
        """Return the probabilities [n], 0..1, that features [n, d] show this class.

        Softmax over the C classes, in float64. Raises KeyError for an unknown class.
        """
        if class_name not in self.classes:
            raise KeyError(class_name)
        scores = features.astype(np.float64) @ self.weight.T + self.bias
        odds = np.exp(scores - scores.max(axis=1, keepdims=True))  # no overflow
        return odds[:, self.classes.index(class_name)] / odds.sum(axis=1)


def read_class_head(path: Path) -> ClassHead:
    """Read the layer that predicts the class from the weights of `fd-views`.

    Raises BadInput for a file without one.
    """
    try:
        with safe_open(path, framework="np") as file:
            classes = tuple(json.loads((file.metadata() or {})["labels"])["classes"])
            weight, bias = (file.get_tensor(f"heads.class.{part}") for part in ("weight", "bias"))
    except Exception as error:  # safetensors raises types of its own
        reason = " ".join(str(error).split())
        raise BadInput(
            f"{path}: not the weights of fd-views ({reason}); install pc2pix-bench again"
        ) from error
    return ClassHead(classes, weight.astype(np.float64), bias.astype(np.float64))


def confidences(
    image_sets: Iterable[ImageSet], features: FeatureDistances, head: ClassHead
) -> Iterator[pd.DataFrame]:
    """Yield the images of each set with a column of the classifier's confidence in their class.

    The head is applied to the features that a run has kept: nothing is drawn or loaded again.
    """
    (metric,) = RECOGNITION_METRICS
    for image_set in image_sets:
        method, condition, class_name = image_set
        images = features.images(*image_set)
        values = []
        for start in range(0, len(images), FEATURES_AT_ONCE):
            part = images[start : start + FEATURES_AT_ONCE]
            values.append(head.confidence(features.of(*image_set, part), class_name))
        if images:
            frame = pd.DataFrame(images, columns=["object", "view"])
            frame = frame.assign(method=method, condition=condition, **{"class": class_name})
            yield frame.assign(**{column(metric): np.concatenate(values)})
