"""What `surface-fit` costs and is worth, beside `surface-apss`.

    python -m benchmarks.surface_fit [--dataset procedural|folder:PATH] [--limit 20] [--views 20]
                                     [--conditions 2048,1024,512,noise-0.05,noise-0.10]

Both methods reconstruct the same clouds of chairs and draw the same views, in turns, in one process
with the environment of a worker. Times are medians over objects, by stage, in seconds of processor
time and, in brackets, of wall time; the cost is that of a cloud and all its views. The ratio is
that of the median costs, in brackets the smallest and largest of an object, then the same by wall
time. SSIM is paired: the mean over objects of the difference, with its 95 % bootstrap interval.
`fd-views` is the distance from the true pictures, and the difference of the two distances, with
95 % jackknife intervals over objects.

An object that either method fails on is named and left out of both. Leave the machine alone
meanwhile.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from statistics import median
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from baselines.surface import SurfaceApss
from baselines.surface_fit import SurfaceFit
from bench.analysis.intervals import mean_interval
from bench.catalogue.lookup import find
from bench.catalogue.metrics import Extractor, find_extractor
from bench.metrics.frechet import frechet_distance, frechet_interval
from bench.metrics.structural_similarity import ssim_per_image
from bench.running.isolation import WORKER_ENVIRONMENT
from data_prep.conditions import CONDITIONS
from data_prep.datasets import SceneObject, open_dataset
from data_prep.failures import StageFailure
from data_prep.images import to_uint8
from data_prep.randomness import generator
from data_prep.render import render
from data_prep.sampling import random_views, sample_surface
from data_prep.scene import PointCloud, View

Result = TypeVar("Result")
METHODS = {"surface-apss": SurfaceApss(), "surface-fit": SurfaceFit()}
PAPERS = "2048,1024,512,noise-0.05,noise-0.10"
SEED = 0


@dataclass(frozen=True)
class Seconds:
    """Of processor and of wall time."""

    cpu: float
    wall: float

    def __add__(self, other: Seconds) -> Seconds:
        return Seconds(self.cpu + other.cpu, self.wall + other.wall)


@dataclass(frozen=True, eq=False)
class Taken:
    """One method on one cloud: ssim [V], features [V, d]."""

    prepare: Seconds
    draw: Seconds
    faces: int
    ssim: NDArray[np.float64]
    features: NDArray[np.float32]

    @property
    def cost(self) -> Seconds:
        """Of the cloud and all its views."""
        return self.prepare + self.draw


def main() -> None:
    """Measure and print."""
    if any(os.environ.get(name) != value for name, value in WORKER_ENVIRONMENT.items()):
        # Libraries read it when they are loaded, and glibc when the process starts.
        command = [sys.executable, "-m", "benchmarks.surface_fit", *sys.argv[1:]]
        os.execve(sys.executable, command, os.environ | WORKER_ENVIRONMENT)
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--dataset", default="procedural")
    options.add_argument("--limit", type=int, default=20, help="objects")
    options.add_argument("--views", type=int, default=20, help="of each object")
    options.add_argument("--conditions", default=PAPERS, help="comma-separated")
    given = options.parse_args()
    import torch

    torch.set_num_threads(1)
    source = find_extractor("fd-views")
    extractor = source.load(str(source.weights(None)))
    objects = open_dataset(given.dataset).objects("chair", given.limit, given.limit)
    loads = ", ".join(f"{load:.2f}" for load in os.getloadavg())
    print(f"{given.dataset}: {len(objects)} chairs x {given.views} views; load {loads}")
    for condition in given.conditions.split(","):
        report(condition, objects, given.views, extractor)


def report(
    condition: str, objects: Sequence[SceneObject], views: int, extractor: Extractor
) -> None:
    """One condition: each object in turns, then a line a method and one that compares them."""
    truth: list[NDArray[np.float32]] = []
    taken: dict[str, list[Taken]] = {method: [] for method in METHODS}
    for scene_object in objects:
        mesh = scene_object.load()
        identity = (scene_object.class_name, scene_object.object_id)
        shown = random_views(views, generator(SEED, "views", *identity))
        sampled = sample_surface(mesh, generator(SEED, "cloud", *identity))
        perturbation = find(condition, CONDITIONS, "condition").perturbation
        cloud = perturbation.apply(sampled, generator(SEED, condition, *identity))
        true = render(mesh, shown)
        try:
            rows = [
                measure(method, PointCloud(cloud.points), shown, true, extractor)
                for method in METHODS
            ]
        except StageFailure as failure:
            print(f"{condition}: {scene_object.object_id} left out, {failure}")
            continue
        truth.append(extractor(true))
        for method, row in zip(METHODS, rows, strict=True):
            taken[method].append(row)
    if len(truth) < 3:
        print(f"{condition}: {len(truth)} chairs are too few for intervals")
        return
    print(f"\n{condition}")
    for method, rows in taken.items():
        print_method(method, rows, truth)
    print_comparison(taken["surface-apss"], taken["surface-fit"], truth)


def measure(
    method: str,
    cloud: PointCloud,
    views: Sequence[View],
    true: NDArray[np.uint8],
    extractor: Extractor,
) -> Taken:
    """One method on one cloud, timed."""
    renderer = METHODS[method]
    state, prepare = timed(lambda: renderer.prepare(cloud))
    images, draw = timed(lambda: renderer.draw(state, views))
    pictures = to_uint8(images)
    ssim = ssim_per_image(true, pictures).ssim
    return Taken(prepare, draw, len(state.mesh.faces), ssim, extractor(pictures))


def timed(work: Callable[[], Result]) -> tuple[Result, Seconds]:
    """What `work` gives, and what it took."""
    cpu, wall = time.process_time(), time.perf_counter()
    result = work()
    return result, Seconds(time.process_time() - cpu, time.perf_counter() - wall)


def print_method(method: str, rows: Sequence[Taken], truth: Sequence[NDArray[np.float32]]) -> None:
    """Times by stage, faces, SSIM and fd-views."""
    times = []
    for stage in ("prepare", "draw", "cost"):
        seconds = [getattr(row, stage) for row in rows]
        cpu, wall = median(s.cpu for s in seconds), median(s.wall for s in seconds)
        times.append(f"{stage} {cpu:.3f} ({wall:.3f}) s")
    features, true, groups = stacked(rows, truth)
    low, high = frechet_interval(true, features, groups, groups)
    print(
        f"  {method:<13} {', '.join(times)}; {median(row.faces for row in rows):,.0f} faces; "
        f"SSIM {np.mean([row.ssim for row in rows]):.4f}; "
        f"fd-views {frechet_distance(true, features):.1f} [{low:.1f}, {high:.1f}]"
    )


def print_comparison(
    apss: Sequence[Taken], fit: Sequence[Taken], truth: Sequence[NDArray[np.float32]]
) -> None:
    """`fit` against `apss`, paired."""
    ratios = []
    for clock in ("cpu", "wall"):
        slow, fast = ([getattr(row.cost, clock) for row in rows] for rows in (apss, fit))
        each = [a / b for a, b in zip(slow, fast, strict=True)]
        ratios.append(f"{median(slow) / median(fast):.1f}x ({min(each):.1f}-{max(each):.1f})")
    gains = np.array([b.ssim.mean() - a.ssim.mean() for a, b in zip(apss, fit, strict=True)])
    low, high = mean_interval(gains)
    moved, fd_low, fd_high = frechet_change(apss, fit, truth)
    print(
        f"  cheaper {ratios[0]}, by wall time {ratios[1]}; "
        f"dSSIM {gains.mean():+.4f} [{low:+.4f}, {high:+.4f}]; "
        f"dfd-views {moved:+.1f} [{fd_low:+.1f}, {fd_high:+.1f}]"
    )


def frechet_change(
    before: Sequence[Taken], after: Sequence[Taken], truth: Sequence[NDArray[np.float32]]
) -> tuple[float, float, float]:
    """Difference of the distances from the truth, and its jackknife interval over objects."""

    def change(kept: Sequence[int]) -> float:
        true = np.concatenate([truth[i] for i in kept])
        old, new = (np.concatenate([rows[i].features for i in kept]) for rows in (before, after))
        return frechet_distance(true, new) - frechet_distance(true, old)

    everyone = range(len(truth))
    left_out = np.array([change([i for i in everyone if i != j]) for j in everyone])
    g = len(truth)
    error = float(np.sqrt((g - 1) / g * np.sum((left_out - left_out.mean()) ** 2)))
    moved = change(everyone)
    return moved, moved - 1.96 * error, moved + 1.96 * error


def stacked(
    rows: Sequence[Taken], truth: Sequence[NDArray[np.float32]]
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.int64]]:
    """Features of a method and of the truth [n, d], and the object of each row [n]."""
    groups = np.repeat(np.arange(len(rows)), [len(row.features) for row in rows])
    return np.concatenate([row.features for row in rows]), np.concatenate(truth), groups


if __name__ == "__main__":
    main()
