"""The proof of the search for extremes: 21 seeded faults, and how soon each is found.

`python -m tests.robustness.seeded_faults --seconds 60` prints them.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np

from bench.catalogue.methods import Method, find_method
from bench.catalogue.suites import Limits
from bench.metrics.structural_similarity import ssim_per_image
from bench.running.isolation import TaskPool
from bench.running.work import load_renderer
from bench.suites.stability.metrics import Metric
from bench.suites.stability.oracles import MethodSubject, MetricSubject, SearchSubject, examine
from bench.suites.stability.search import SEED_STEP, FailingInput, Rounds
from data_prep.scene import Images, PointCloud, Points, Renderer, View

LIMITS = Limits(time_s=6.0, memory_gib=2.0)
FIRST: list[PointCloud] = []  # the cloud that a faulty method keeps
CALLS: list[int] = []


def _extent(points: Points) -> Any:
    return points.max(axis=0) - points.min(axis=0) if len(points) else np.ones(3)


def _divide(points: Points) -> None:
    assert 1.0 / float(_extent(points).max()) >= 0.0


def _hang(points: Points) -> None:
    while len(np.unique(points, axis=0)) < len(points):
        time.sleep(1.0)


def _end(points: Points) -> None:
    if len(points) > 1 and _extent(points)[2] == 0.0:
        os._exit(3)


def _pair_up(points: Points) -> None:
    points[1:].reshape(-1, 2, 3)


def _fill_memory(points: Points) -> None:
    if len(points) > 10_000:
        np.ones((len(points), len(points)))


def _denormal(points: Points) -> None:
    small = np.abs(points)
    if ((small > 0) & (small < 1e-38)).any():
        raise FloatingPointError("underflow")


def _alpha_wrap(points: Points) -> None:
    if len(points) == 0:
        return
    pymeshlab: Any = import_module("pymeshlab")  # without types
    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(points.astype(np.float64)))
    meshes.generate_alpha_wrap()


IN_PREPARE: Mapping[str, Callable[[Points], object]] = {
    "no first point": lambda points: points[0],
    "division by the extent": _divide,
    "pairs of points": _pair_up,
    "hang on equal points": _hang,
    "end without depth": _end,
    "square of the count in memory": _fill_memory,
    "denormal numbers": _denormal,
    "alpha wrap of a cloud": _alpha_wrap,
}
IN_VIEW: Mapping[str, Callable[[View], object]] = {
    "pole": lambda view: np.linalg.inv(np.diag([1.0, 90.0 - abs(view.elevation_deg)])),
    "huge azimuth": lambda view: int(view.azimuth_deg).to_bytes(8, signed=True),
}
# Functions of the images, and of the cloud.
IN_DRAW: Mapping[str, Callable[[Images, Points], Any]] = {
    "NaN above 1e19": lambda i, p: i * np.where((np.abs(p) > 1e19).any(), np.nan, 1).astype("f4"),
    "overflow at 1e30": lambda i, p: i * (1 + np.abs(p).max(initial=0) // np.float32(1e30)),
    "order": lambda i, p: i * np.float32(0.5 if len(p) > 1 and p[0, 0] > p[-1, 0] else 1.0),
    "shape of one view": lambda i, p: i[0] if len(i) == 1 else i,
    "count of calls": lambda i, p: i * np.float32(1.0 - 0.01 * len(CALLS)),
    "two points": lambda i, p: i.astype(np.uint8) if len(p) == 2 else i,
}
KEEPS_FIRST = "first cloud for all"
METHODS = (*IN_PREPARE, *IN_VIEW, *IN_DRAW, KEEPS_FIRST)


class _Faulty:
    """The method splat with a fault."""

    def __init__(self, fault: str, renderer: Renderer) -> None:
        self.fault, self.renderer = fault, renderer

    def prepare(self, cloud: PointCloud, rng: np.random.Generator) -> Any:
        if self.fault in IN_PREPARE:
            IN_PREPARE[self.fault](cloud.points)
        if self.fault == KEEPS_FIRST and len(cloud) and np.isfinite(cloud.points).all():
            FIRST.append(cloud)
            cloud = FIRST[0]
        return cloud.points, self.renderer.prepare(cloud, rng)

    def draw(self, state: Any, views: Sequence[View], rng: np.random.Generator) -> Images:
        points, inner = state
        CALLS.append(0)
        for view in views if self.fault in IN_VIEW else ():
            IN_VIEW[self.fault](view)
        images = self.renderer.draw(inner, views, rng)
        return IN_DRAW[self.fault](images, points) if self.fault in IN_DRAW else images


@dataclass(frozen=True)
class FaultyMethod(MethodSubject):
    """The method splat with the fault of its id."""

    order_free: bool = True
    most_points: int = 20_000

    def load(self) -> tuple[Method, Renderer]:
        return find_method("splat"), _Faulty(self.id, load_renderer("splat", "cpu"))


def _correlation(a: Any, b: Any) -> Any:
    a, b = (images.reshape(len(images), -1).astype(float) for images in (a, b))
    a, b = (images - images.mean(axis=1, keepdims=True) for images in (a, b))
    return (a * b).sum(axis=1) / np.sqrt((a**2).sum(axis=1) * (b**2).sum(axis=1))


def _overlap(a: Any, b: Any) -> Any:
    shown = [(images < 250).any(axis=-1).sum(axis=(1, 2)) for images in (a, b)]
    return np.minimum(*shown) / np.maximum(shown[0], 1)


def _textbook(a: Any, b: Any) -> float:
    from scipy.linalg import sqrtm

    roots = sqrtm(np.cov(a, rowvar=False) @ np.cov(b, rowvar=False))
    shift = a.mean(axis=0) - b.mean(axis=0)
    traces = sum(np.trace(np.atleast_2d(np.cov(x, rowvar=False))) for x in (a, b))
    return float(shift @ shift + traces - 2 * np.trace(np.atleast_2d(roots)).real)


METRICS: Mapping[str, tuple[str, Callable[[Any, Any], Any]]] = {  # the metric that each stands for
    "correlation of flat images": ("structure", _correlation),
    "overlap by the true object": ("silhouette-iou", _overlap),
    "textbook distance": ("frechet-distance", _textbook),
    "offset of identical images": ("ssim", lambda a, b: ssim_per_image(a, b).ssim * 0.999),
}


@dataclass(frozen=True)
class FaultyMetric(MetricSubject):
    """A metric that is computed in a wrong way."""

    fault: str = ""

    def load(self) -> Metric:
        return METRICS[self.fault][1]


SUBJECTS: Mapping[str, MethodSubject | MetricSubject] = {
    **{fault: FaultyMethod(fault) for fault in METHODS},
    **{fault: FaultyMetric(metric, fault) for fault, (metric, _) in METRICS.items()},
}


def first_failure(
    subject: SearchSubject,
    seconds: float,
    seed: int = 0,
    clock: Callable[[], float] = time.monotonic,
) -> FailingInput | None:
    """Return the first failure within a time, its input reduced; None where there is none."""
    with closing(TaskPool(examine, 1, LIMITS)) as pool:
        rounds = Rounds(subject, seconds, pool, clock)
        while not rounds.result.failing and rounds.result.seconds < seconds:
            rounds.carry_out(seed)
            seed += SEED_STEP
    return next(iter(rounds.result.failing.values()), None)


def main() -> None:
    """Print each fault with the time and the inputs until it is found."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=60.0, help="at most, for each fault")
    parser.add_argument("fault", nargs="*", choices=[[], *SUBJECTS], help="all by default")
    arguments, count = parser.parse_args(), 0
    seconds, faults = arguments.seconds, arguments.fault or list(SUBJECTS)
    for fault in faults:
        found = first_failure(SUBJECTS[fault], seconds)
        count += found is not None
        if found is None:
            print(f"{fault:30} not found in {seconds:g} s", flush=True)
        else:
            print(f"{fault:30} {found.seconds:5.1f} s {found.inputs:5} inputs: {found.problem}")
            print(f"{'':30} {found.input!r}", flush=True)
    print(f"{count} of {len(faults)} faults found")


if __name__ == "__main__":
    main()
