"""Clouds and true images of many objects, in memory, for training."""

from __future__ import annotations

import functools
import multiprocessing
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from data_prep.arrays import Floats
from data_prep.datasets.objects import SceneObject
from data_prep.failures import BadInput
from data_prep.progress import progress
from data_prep.randomness import generator
from data_prep.scene import CLOUD_SIZE, IMAGE_SIZE, NEUTRAL_GREY, Points, View, in_one_colour

_Made = TypeVar("_Made")
BLACK = (0, 0, 0)
# The points of a cloud of `training_clouds`: twice as many as the encoder reads, so that each step
# of a training can take another half of them.
_CLOUD_POINTS = 4096
DATA_SEED = 0  # the seed of clouds and views, the same for all trainings, so that all see the same
# The fewest objects for each worker process: fewer are made sooner than a process has started.
_FEWEST_A_WORKER = 100


@dataclass(frozen=True, eq=False)
class TrainingSet:
    """N objects, each with a cloud and V images.

    images         uint8 [N, V, IMAGE_SIZE, IMAGE_SIZE, 3], white background
    azimuth_deg    float64 [N, V], -180..180
    elevation_deg  float64 [N, V], -40..40
    clouds         float32 [N, CLOUD_SIZE, 3], unit-sphere coordinates
    """

    images: NDArray[np.uint8]
    azimuth_deg: NDArray[np.float64]
    elevation_deg: NDArray[np.float64]
    clouds: NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class SurfaceSet:
    """A TrainingSet of meshes with two more images of each view.

    seen      the set itself
    coverage  uint8 [N, V, IMAGE_SIZE, IMAGE_SIZE]: the share of a pixel that the object covers,
              from 0 to 255 for the whole pixel
    grey      uint8 [N, V, IMAGE_SIZE, IMAGE_SIZE]: the object in NEUTRAL_GREY on white
    """

    seen: TrainingSet
    coverage: NDArray[np.uint8]
    grey: NDArray[np.uint8]


def add_surfaces(
    seen: TrainingSet, objects: Sequence[SceneObject], *, quiet: bool = False
) -> SurfaceSet:
    """Render coverage and grey images of the objects of a set; show progress on stderr.

    Raises BadInput for an object without a mesh.
    """
    from data_prep.rendering.opengl import render

    shape = seen.images.shape[:-1]
    coverage, grey_images = np.empty(shape, np.uint8), np.empty(shape, np.uint8)
    with progress("silhouettes", len(objects), quiet=quiet) as advance:
        for i, obj in enumerate(objects):
            mesh = obj.load()
            views = list(map(View, seen.azimuth_deg[i], seen.elevation_deg[i]))
            for colour, images in ((BLACK, coverage), (NEUTRAL_GREY, grey_images)):
                images[i] = render(in_one_colour(mesh, colour), views)[..., 0]
            advance(0)
    return SurfaceSet(seen, 255 - coverage, grey_images)


def training_set(
    objects: Sequence[SceneObject],
    views: int,
    *,
    seed: int = DATA_SEED,
    quiet: bool = False,
    workers: int = 1,
) -> TrainingSet:
    """Return clouds and images of objects, made by `workers` processes; show progress on stderr.

    The same arguments give the same arrays on the same driver, so nothing needs to be kept between
    runs: 1,500 chairs of 8 views take about half a minute and 0.6 GB. Raises BadInput for an object
    that cannot be loaded.
    """
    count = len(objects)
    images = np.empty((count, views, IMAGE_SIZE, IMAGE_SIZE, 3), np.uint8)
    angles = np.empty((2, count, views))
    clouds = np.empty((count, CLOUD_SIZE, 3), np.float32)
    with progress("rendering", count, quiet=quiet) as advance:
        draw = functools.partial(_seen, views, seed)
        for i, of_object in enumerate(_in_processes(draw, objects, workers)):
            clouds[i], images[i], angles[:, i] = of_object
            advance(0)
    return TrainingSet(images, angles[0], angles[1], clouds)


def _seen(views: int, seed: int, obj: SceneObject) -> tuple[Points, NDArray[np.uint8], Floats]:
    """Return the points of an object, its images, and azimuths and elevations [2, V]."""
    key = (seed, obj.class_name, obj.object_id)
    cameras = obj.views(views, generator("training views", *key))
    cloud, images = obj.cloud_and_truth(generator("training cloud", *key), cameras)
    angles = np.array([(v.azimuth_deg, v.elevation_deg) for v in cameras]).T
    return cloud.points, images, angles


def _in_processes(
    work: Callable[[SceneObject], _Made], objects: Sequence[SceneObject], workers: int
) -> Iterator[_Made]:
    """Yield the results in the order of the objects; for few objects no processes are started."""
    workers = min(workers, len(objects) // _FEWEST_A_WORKER)
    if workers <= 1:
        yield from map(work, objects)
        return
    # The processes are spawned, as OpenGL and threads do not work in a forked process.
    spawn, deaf = multiprocessing.get_context("spawn"), (signal.SIGINT, signal.SIG_IGN)
    with ProcessPoolExecutor(workers, spawn, signal.signal, deaf) as pool:
        try:
            yield from pool.map(work, objects, chunksize=4)
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise


def training_clouds(
    objects: Sequence[SceneObject], *, quiet: bool = False, workers: int = 1
) -> NDArray[np.float32]:
    """Return clouds float32 [N, M, 3], made by `workers` processes; show progress on stderr.

    M is _CLOUD_POINTS, or the number of points of objects that are smaller clouds themselves. The
    same objects give the same clouds. Raises BadInput for clouds with different numbers of points.
    """
    clouds: list[NDArray[np.float32]] = []
    with progress("sampling", len(objects), quiet=quiet) as advance:
        for obj, points in zip(objects, _in_processes(_sampled, objects, workers), strict=True):
            clouds.append(points)
            advance(0)
            if len(clouds[-1]) != len(clouds[0]):
                raise BadInput(
                    f"{obj.class_name}/{obj.object_id}: {len(clouds[-1])} points, and "
                    f"{objects[0].object_id} has {len(clouds[0])}, of at most {_CLOUD_POINTS} that "
                    f"are taken; give clouds of one size, or of at least {_CLOUD_POINTS} points"
                )
    return np.stack(clouds)


def _sampled(obj: SceneObject) -> Points:
    rng = generator(DATA_SEED, "training cloud", obj.class_name, obj.object_id)
    return obj.cloud(rng, _CLOUD_POINTS).points
