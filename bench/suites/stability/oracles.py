"""The subjects of the search for extremes: a method or a metric, and what holds for any input."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from hashlib import sha256
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from bench.catalogue.gone import unknown
from bench.catalogue.methods import Method, find_method
from bench.catalogue.metrics import DISTANCES_OF_IMAGES, JUDGE, RANGES, UNDEFINED
from bench.running.work import checked_images, draw, load_renderer, reason_of
from bench.suites.stability import generated
from bench.suites.stability.cases import CASES
from bench.suites.stability.expectations import (
    EXACT_MEAN,
    EXPECTED,
    Agrees,
    Either,
    Fails,
    expectation,
)
from bench.suites.stability.feature_cases import rounding_of
from bench.suites.stability.generated import Array, CloudInput
from bench.suites.stability.metric_cases import CODE_LENGTH, FRECHET, rounding
from bench.suites.stability.metrics import DISTANCES, METRICS, Metric
from bench.suites.stability.outcomes import names_stage
from data_prep.failures import StageFailure
from data_prep.randomness import generator
from data_prep.scene import CLOUD_SIZE, Images, PointCloud, Renderer, UInt8Images, View

if TYPE_CHECKING:
    from hypothesis.strategies import SearchStrategy

SLOW_POINTS = 2_000  # the most for methods that are expected to take minutes for MANY
# Qhull takes over a minute for 12,000 points of the faces of a cube, and a second for 16,000 of a
# chair (tests/upstream/test_library_defects.py).
SLOW = ("alpha-shape", "denoised-alpha")
MANY, SHUFFLED = "100000-points", "shuffled"
ANGLES = ("azimuth-error-deg", "elevation-error-deg")
DIRECTED = (  # silhouettes are drawn by the contrast of the true image
    *("ssim-object", "silhouette-iou", "thin-recall", "thin-precision", JUDGE, *ANGLES),
)
NETWORKS = 1e-5  # rounding of metrics whose network computes in float32
DECIBELS = 0.01  # the largest PSNR has two digits
RANGE_OF = RANGES | {JUDGE: (1 - CODE_LENGTH, 1 + CODE_LENGTH), ANGLES[0]: (0.0, 180.0)}
BEST = {  # of an array and itself
    name: 0.0 if name in (*DISTANCES, *DISTANCES_OF_IMAGES) else RANGES[name][1]
    for name in METRICS
    if name not in (JUDGE, *ANGLES)
}


@dataclass(frozen=True)
class Examination:
    """The outcome of one input.

    problem  why it is unexpected; empty where it is as expected
    refused  the named failure of an input that is refused; else empty
    digest   of the images; empty without them
    """

    problem: str = ""
    refused: str = ""
    digest: str = ""


class SearchSubject(Protocol):
    """A method or a metric to be searched. It crosses process boundaries."""

    @property
    def id(self) -> str:
        """Return the id of the method or metric."""
        ...

    def inputs(self) -> SearchStrategy[Any]:
        """Return the strategy of its inputs."""
        ...

    def examine(self, given: Any) -> Examination:
        """Return the outcome of an input, in a worker."""
        ...


def examine(task: tuple[SearchSubject, Any]) -> Examination:
    """Return the outcome of an input, whatever the subject raises: the work of a worker."""
    subject, given = task
    try:
        return subject.examine(given)
    except BaseException as error:  # a method may call exit(), or raise KeyboardInterrupt
        return Examination(reason_of(error))


# --- methods --------------------------------------------------------------------------------------


class _Strict:
    """A renderer whose images are checked: the harness makes a named failure of wrong ones."""

    def __init__(self, renderer: Renderer) -> None:
        self.renderer = renderer
        self.prepare = renderer.prepare

    def draw(self, state: Any, views: Sequence[View], rng: np.random.Generator) -> Images:
        """Return the renderer's images. Raises ValueError for anything but images in [0, 1]."""
        images = self.renderer.draw(state, views, rng)
        try:
            checked_images(images, len(views))
        except StageFailure as error:
            raise ValueError(error.problem) from error
        if images.min() < 0.0 or images.max() > 1.0:
            raise ValueError(f"pixels {images.min():g} to {images.max():g}, expected [0, 1]")
        return images


@dataclass(frozen=True)
class MethodSubject:
    """A method, which draws clouds or fails with the name of a stage.

    order_free   whether another order of the points has to give the same images
    most_points  of generated clouds
    """

    id: str
    device: str = "cpu"
    order_free: bool = False
    most_points: int = generated.MOST_POINTS

    def inputs(self) -> SearchStrategy[CloudInput]:
        """Return the strategy of clouds and views."""
        return generated.clouds(self.most_points)

    def load(self) -> tuple[Method, Renderer]:
        """Return the method and its renderer."""
        return find_method(self.id), load_renderer(self.id, self.device)

    def examine(self, given: CloudInput) -> Examination:
        """Draw a cloud twice, and where the order is not to count in reverse."""
        cloud = given.cloud()
        images, reason = self._draw(cloud, given.views)
        again, reason_again = self._draw(cloud, given.views)
        if reason and not names_stage(reason):
            return Examination(reason)
        if reason != reason_again or not np.array_equal(images, again):
            return Examination(f"other the second time: {reason_again or 'images'}; {reason}")
        if self.order_free and _is_plain(cloud):
            reversed_cloud = PointCloud(cloud.points[::-1], cloud.source)
            reordered, other_reason = self._draw(reversed_cloud, given.views)
            if bool(other_reason) != bool(reason):
                return Examination(f"other in reverse: {other_reason or 'images'}; {reason}")
            change = np.abs(images.astype(np.int16) - reordered)
            # Single pixels may change: of faces that share an edge, the first drawn has it.
            if change.size and change.mean() > EXACT_MEAN:
                mean, most = change.mean(), change.max()
                return Examination(f"images change in reverse by {mean:.2g}, at most {most}")
        return Examination(refused=reason, digest=sha256(images.tobytes()).hexdigest())

    def _draw(self, cloud: PointCloud, views: tuple[View, ...]) -> tuple[UInt8Images, str]:
        """Return the images, or none and the reason."""
        rng = generator("search", self.id)
        try:
            method, renderer = self.load()
            return draw(method, _Strict(renderer), cloud, views, rng).images, ""
        except BaseException as error:  # as in `bench.running.work.run_job`
            return np.empty(0, np.uint8), reason_of(error)


def _is_plain(cloud: PointCloud) -> bool:
    """Return whether the order of points is not to count: near the unit sphere, and few enough."""
    # Elsewhere sums in float32 lose all digits in one order and keep some in another; networks see
    # a random part of a larger cloud.
    points = cloud.points
    return len(points) <= CLOUD_SIZE and bool((np.abs(points) <= 1.0).all())


def method_subject(method: str, device: str) -> MethodSubject:
    """Return the subject of a method; what is expected of it is in `EXPECTED`."""
    cases = {case.id: case for case in CASES}
    order_free = isinstance(expectation(method, cases[SHUFFLED]), Agrees)
    many = expectation(method, cases[MANY])
    options = many.options if isinstance(many, Either) else (many,)
    slow = method in SLOW or any(isinstance(o, Fails) and o.kind == "contained" for o in options)
    most = SLOW_POINTS if slow else generated.MOST_POINTS
    return MethodSubject(method, device, order_free and method in EXPECTED, most)


# --- metrics --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class MetricSubject:
    """A metric: a value in its range, or a ValueError that says why there is none.

    Identical inputs have the best value, and two inputs the same in either order where the metric
    is symmetric. NumPy's warnings are problems.
    """

    id: str

    def inputs(self) -> SearchStrategy[Any]:
        """Return the strategy of features for a distance, of angles, or else of images."""
        if self.id in ANGLES:
            return generated.angles()
        return generated.features() if self.id == FRECHET else generated.images()

    def load(self) -> Metric:
        """Return the function."""
        return METRICS[self.id]

    def examine(self, given: Any) -> Examination:
        """Measure a pair, a thing with itself, and the pair in reverse."""
        first, second = given.arrays()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error", RuntimeWarning)
                values = np.atleast_1d(self.load()(first, second)).astype(np.float64)
                low, high = RANGE_OF.get(self.id, (0.0, math.inf))
                slack = DECIBELS if self.id == "psnr" else NETWORKS
                nan = np.isnan(values) & (self.id in UNDEFINED)
                if not (nan | ((values >= low - slack) & (values <= high + slack))).all():
                    return Examination(f"{_shown(values)}: outside {low:g} to {high:g}")
                if self.id in BEST and (problem := self._off_itself(first)):
                    return Examination(problem)
                if self.id not in DIRECTED:
                    reverse = np.atleast_1d(self.load()(second, first))
                    if not self._equal(values, reverse, first, second):
                        return Examination(f"{_shown(values)}, in reverse {_shown(reverse)}")
        except ValueError as error:
            if type(error).__name__ == "ValueError" and not str(error):
                return Examination("ValueError: no message")
            return Examination(refused=reason_of(error))
        return Examination(digest=sha256(values.tobytes()).hexdigest())

    def _off_itself(self, array: Array) -> str:
        """Return why the metric of an array and itself is not the best; empty where it is."""
        values = np.atleast_1d(self.load()(array, array.copy())).astype(np.float64)
        values = values[~np.isnan(values)] if self.id in UNDEFINED else values
        best = BEST[self.id]
        if self.id == "psnr":  # one level of one channel
            best = 20 * math.log10(255) + 10 * math.log10(array[0].size)
        equal = self._equal(values, np.full_like(values, best), array, array)
        return "" if equal else f"{_shown(values)} of identical inputs, expected {best:g}"

    def _equal(self, values: Array, expected: Array, first: Array, second: Array) -> bool:
        if self.id == FRECHET:
            within = 2 * rounding(first, second)
        elif self.id in DISTANCES:
            within = 2 * rounding_of(self.id, first, second)
        else:
            within = DECIBELS if self.id == "psnr" else NETWORKS
        return values.shape == expected.shape and bool(
            np.allclose(values, expected, rtol=0.0, atol=within, equal_nan=True)
        )


def _shown(values: Array) -> str:
    """Return the least and the largest value as text, so that sets of any size fail alike."""
    return f"{values.min(initial=math.inf):.6g} to {values.max(initial=-math.inf):.6g}"


def metric_subject(metric: str) -> MetricSubject:
    """Return the subject of a metric. Raises BadInput for an unknown one."""
    if metric not in METRICS:
        raise unknown(metric, list(METRICS), "metric")
    return MetricSubject(metric)
