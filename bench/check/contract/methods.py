"""The contract of a method: its images and its inputs."""

from __future__ import annotations

import resource
import sys
import time
from collections.abc import Sequence
from functools import cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.catalogue.method_files import data_files, declared_files, told_files
from bench.catalogue.methods import FLOORS, Method, is_module_name
from bench.catalogue.suites import Limits
from bench.check.contract.files import unknown_files, watch_files
from bench.check.contract.findings import ContractViolation, checked_identity
from bench.check.contract.session import CheckStep, Passed
from bench.check.contract.targets import find_target
from bench.running.work import checked_images, draw, reason_of, seen_by
from data_prep.clouds.conditions import Perturbation
from data_prep.clouds.extremes import extreme
from data_prep.datasets.registry import ProceduralObject
from data_prep.failures import BadInput, StageFailure
from data_prep.plugins import announced, entry_point_folder
from data_prep.randomness import generator
from data_prep.scene import IMAGE_SIZE, PointCloud, Renderer, UInt8Images, View

LIMITS = Limits(time_s=20.0, memory_gib=4.0)  # the limits of each step of a test
VIEWS = (View(30.0, 20.0), View(-60.0, -10.0), View(120.0, 35.0))
_LEVELS_DEG = (-30.0, 0.0, 30.0)
# 20 views, as many as a run has of an object, in steps of 18 degrees around it.
TURN = tuple(View(18.0 * i - 180, _LEVELS_DEG[i % 3]) for i in range(20))
BATCHES = (1, 3)  # numbers of views in a call whose images are compared with those of one call
# Extreme clouds that a method has to draw, or to refuse with a StageFailure.
EXTREMES: dict[str, Perturbation] = {
    "no points": extreme("Count", 0),
    "one point": extreme("Count", 1),
    "three points": extreme("Count", 3),
    "equal points": extreme("Equal"),
    "points on a line": extreme("Flattened", 1),
    "points in a plane": extreme("Flattened", 2),
    "20,000 points": extreme("Count", 20_000),
    "a far point": extreme("FirstPoint", 1e30),
    "a tiny cloud": extreme("Scaled", 1e-30),
}
# Clouds with points that are not finite. A run gives no method such points, a user of it may.
NOT_FINITE: dict[str, Perturbation] = {
    "a point at NaN": extreme("FirstPoint", float("nan")),
    "a point at infinity": extreme("FirstPoint", float("inf")),
}
# Modules whose reads of `source` do not count: they copy or print a cloud with all its fields.
_COPYING = ("dataclasses", "data_prep.scene", "copy")


class _WatchedCloud(PointCloud):
    """A cloud that notices whether a method reads its `source`, the mesh behind it."""

    source_is_read = False

    def __getattribute__(self, name: str) -> Any:
        """Return the attribute, and note a read of the source."""
        if name == "source" and sys._getframe(1).f_globals.get("__name__") not in _COPYING:
            object.__setattr__(self, "source_is_read", True)
        return super().__getattribute__(name)


def _method(name: str) -> Method:
    method = find_target(name)
    assert isinstance(method, Method)
    return method


@cache
def _renderer(name: str) -> Renderer:
    """Return the renderer of a method, which is loaded once in a process, as in a run."""
    return _method(name).load("auto")


def chair(index: int = 0) -> PointCloud:
    """Return the cloud of a chair, with its mesh, as a run gives it to a condition."""
    return ProceduralObject("chair", "validation", index).cloud(generator("contract"))


def _images(name: str, cloud: PointCloud, views: Sequence[View] = VIEWS) -> UInt8Images:
    """Return images as a run draws them, with the same random numbers each time."""
    rng = generator("contract", "method")
    return draw(_method(name), _renderer(name), cloud, views, rng).images


def use(name: str, number: int) -> UInt8Images:
    """Return the images of a cloud from three views."""
    return _images(name, chair(number))


def check_identity(name: str) -> Passed:
    """Check the identity and the version, by which a run knows its finished jobs again."""
    method = _method(name)
    identity = checked_identity(method.version, method.identity)
    text = f"version {method.version}, identity {identity!r} each time"
    if is_module_name(name):
        told = told_files(name, method.declared_files).removeprefix(f"{name}: ")
        return Passed(f"{text}; {told}")
    return Passed(text)


def _check_files(name: str) -> Passed:
    """Check that the data files which the method has read so far are part of its identity."""
    opened = sorted(watch_files())
    if is_module_name(name):
        known = data_files(name, _method(name).declared_files).files
    elif name in announced("method"):
        folder = entry_point_folder("method", name)
        known = tuple(declared_files(name, _method(name).declared_files, folder))
    else:
        return Passed("the checksum of its weights is a part of its identity")
    if unknown := unknown_files(opened, known):
        raise ContractViolation(
            f"reads {', '.join(map(str, unknown))}, and no run would notice a change there; name "
            "it in `files` of the method (docs/extending.md)"
        )
    return Passed(f"{len(known)} beside its code are a part of its identity, and no other is read")


def check_loading(name: str) -> Passed:
    """Load the renderer."""
    start = time.perf_counter()
    renderer = _renderer(name)
    for function in ("prepare", "draw"):
        if not callable(getattr(renderer, function, None)):
            raise ContractViolation(f"{type(renderer).__name__} has no function {function}")
    return Passed(f"{time.perf_counter() - start:.1f} s")


def check_images(name: str) -> Passed:
    """Draw three views of a chair, and check type, shape and range of the images."""
    method, renderer, rng = _method(name), _renderer(name), generator("contract")
    cloud = seen_by(method, chair())
    if not method.sees_mesh:
        cloud = _WatchedCloud(cloud.points)
    before = cloud.points.copy()
    try:
        images = renderer.draw(renderer.prepare(cloud, rng), VIEWS, rng)
    finally:
        if isinstance(cloud, _WatchedCloud) and cloud.source_is_read:
            raise ContractViolation(
                "cloud.source is read, which is None in a run; only a ceiling may look at the "
                "mesh: Method(..., sees_mesh=True)"
            )
    if (kind := getattr(images, "dtype", type(images).__name__)) != np.float32:
        raise ContractViolation(f"images are {kind}, expected float32")
    checked_images(images, len(VIEWS))
    if images.min() < 0 or images.max() > 1:
        raise ContractViolation(
            f"values are in {images.min():.3g} .. {images.max():.3g}, expected 0 .. 1"
        )
    if not np.array_equal(before, cloud.points):
        raise ContractViolation("the points of the cloud were changed; work on a copy")
    # A run draws IMAGE_SIZE pixels; `bench render` draws any size that the method states.
    for side in {IMAGE_SIZE, method.sizes[0], method.sizes[-1]}:
        draw(method, renderer, chair(), VIEWS, generator("contract", "method"), side=side)
    return Passed(f"{list(images.shape)} float32 in {images.min():.2f} .. {images.max():.2f}")


def _check_no_views(name: str) -> Passed:
    """Draw an empty list of views, which has to give an empty array."""
    images = _renderer(name).draw(_prepared(name), (), generator("contract"))
    if np.shape(images) != (0, IMAGE_SIZE, IMAGE_SIZE, 3):
        raise ContractViolation(
            f"gives {np.shape(images)}, expected (0, {IMAGE_SIZE}, {IMAGE_SIZE}, 3)"
        )
    return Passed("an empty array")


def check_batches(name: str) -> Passed:
    """Draw 20 views of one state in calls of 1, of 3 and of 20, and compare the images.

    Where `draw` takes random numbers, images may depend on the views before, so that calls of each
    size are compared with the same calls again.
    """
    state = _prepared(name)
    whole, again = (_drawn(name, state, len(TURN)) for _ in range(2))
    if _method(name).id not in FLOORS and (whole == whole[:1]).all():
        raise ContractViolation("draws the same image from 20 views")
    if not np.array_equal(whole, again):
        raise ContractViolation(
            f"draws other images of the same state the second time: {apart(whole, again)}; take "
            "all randomness from `rng`, and do not change the state in draw"
        )
    is_random = not np.array_equal(whole, _drawn(name, state, len(TURN), "other numbers"))
    for batch in BATCHES:
        images = _drawn(name, state, batch)
        expected = _drawn(name, state, batch) if is_random else whole
        if not np.allclose(images.astype(int), expected, rtol=0, atol=1):  # one grey level of 255
            compared = "twice" if is_random else "and of 20 views"
            raise ContractViolation(
                f"calls of {batch} {compared}: {apart(images, expected)}; an image may not depend "
                "on the other views"
            )
    text = "the same images from 1, 3 and 20 views a call"
    return Passed(f"{text}; draw takes random numbers" if is_random else text)


def _prepared(name: str) -> Any:
    cloud = seen_by(_method(name), chair())
    return _renderer(name).prepare(cloud, generator("contract"))


def _drawn(name: str, state: Any, batch: int, seed: str = "numbers") -> UInt8Images:
    """Return 20 images of a state, `batch` views a call."""
    rng = generator("contract", seed)
    parts = [TURN[i : i + batch] for i in range(0, len(TURN), batch)]
    images = [checked_images(_renderer(name).draw(state, part, rng), len(part)) for part in parts]
    return np.concatenate(images)


def check_inputs(name: str) -> Passed:
    """Check that images depend on the cloud where `sees_cloud` says so, and else do not."""
    sees_cloud, cloud = _method(name).sees_cloud, chair()
    images = _images(name, cloud)
    fewer = _images(name, extreme("Kept", 0.25).apply(cloud, generator("contract", "fewer")))
    if not sees_cloud:
        if not np.array_equal(images, fewer):
            raise ContractViolation(
                f"sees_cloud=False, but with a quarter of the points {apart(images, fewer)}; a "
                "run would draw one condition and use it for all"
            )
        return Passed("the same images for all conditions, as sees_cloud=False says")
    if np.array_equal(images, fewer) and np.array_equal(images, _images(name, chair(1))):
        raise ContractViolation(
            "draws the same images for every cloud; declare it with sees_cloud=False"
        )
    return Passed("the images depend on the cloud")


def _check_extreme(name: str, extreme: str) -> Passed:
    """Check that an extreme cloud is drawn, or refused with a StageFailure or BadInput."""
    cloud = (EXTREMES | NOT_FINITE)[extreme].apply(chair(), generator("contract", extreme))
    method, renderer = _method(name), _renderer(name)
    cloud = seen_by(method, cloud)
    rng = generator("contract", "method")
    try:
        images = renderer.draw(renderer.prepare(cloud, rng), VIEWS[:1], rng)
    except (StageFailure, BadInput) as refusal:
        return Passed(f"refused: {reason_of(refusal)}")
    except Exception as error:
        raise ContractViolation(
            f"{reason_of(error)}; raise StageFailure(stage, problem)"
        ) from error
    if np.shape(images) != (1, IMAGE_SIZE, IMAGE_SIZE, 3) or not np.isfinite(images).all():
        raise ContractViolation("drawn, with a wrong shape or values that are not finite")
    return Passed("drawn")


def _check_cost(name: str) -> Passed:
    """Measure the time and memory of a cloud with as many views as in a run."""
    start = time.perf_counter()
    _drawn(name, _prepared(name), len(TURN))
    seconds = time.perf_counter() - start
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**10  # from KiB, its unit on Linux
    return Passed(f"a cloud with {len(TURN)} views {seconds:.2f} s, {peak:.0f} MiB at most so far")


def apart(first: NDArray[Any], second: NDArray[Any]) -> str:
    """Return in words how far two results are apart."""
    if first.shape != second.shape:
        return f"the shapes are {list(first.shape)} and {list(second.shape)}"
    off = np.abs(first.astype(np.float64) - second)
    return f"{np.count_nonzero(off)} of {off.size} values differ, by up to {off.max():.4g}"


FIRST = (
    CheckStep("loading", check_loading),
    CheckStep("images", check_images),
    CheckStep("no views", _check_no_views, blocks=False),  # no run asks for no views
    CheckStep("batches", check_batches),
    CheckStep("inputs", check_inputs),
)
LAST = (
    *(CheckStep(cloud, partial(_check_extreme, extreme=cloud)) for cloud in EXTREMES),
    CheckStep("cost", _check_cost),
    CheckStep("files", _check_files, blocks=False),  # the file may be the cache of a library
    *(CheckStep(c, partial(_check_extreme, extreme=c), blocks=False) for c in NOT_FINITE),
)
