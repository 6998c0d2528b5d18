"""What a method has to keep to. It is somebody's code and runs in killable workers.

One that hangs, dies or takes all memory is named like any other.
"""

from __future__ import annotations

import resource
import subprocess
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from bench.catalogue.methods import find_method
from bench.catalogue.suites import Limits
from bench.checking.contract.findings import VIEWS, Broken, Finding, tried
from bench.running.isolation import WORKER_ENVIRONMENT, Lost, run_tasks, thread_counts
from bench.running.work import draw, load_renderer, reason_of, seen_by
from bench.running.worker_process import own_python
from data_prep.datasets import ProceduralObject
from data_prep.extremes import Count, Equal, FirstPoint, Flattened, Scaled
from data_prep.failures import BadInput, StageFailure
from data_prep.randomness import generator
from data_prep.scene import IMAGE_SIZE, PointCloud, Renderer, UInt8Images, View

LIMITS = Limits(time_s=20.0, memory_gib=4.0)
RUN_VIEWS = 20  # of a cloud in a run
EXTREMES = {
    "no points": Count(0),
    "one point": Count(1),
    "three points": Count(3),
    "equal points": Equal(),
    "points on a line": Flattened(1),
    "points in a plane": Flattened(2),
    "20,000 points": Count(20_000),
    "a point at NaN": FirstPoint(float("nan")),
    "a point at infinity": FirstPoint(float("inf")),
    "a far point": FirstPoint(1e30),
    "a tiny cloud": Scaled(1e-30),
}
LISTING = """
import sys
from bench.commands.listing import list_all
list_all()
print(*sys.modules, file=sys.stderr)
"""
HEAVY = ("torch", "numpy", "scipy", "pandas")


class Check(NamedTuple):
    """A point of the contract, tested in a worker."""

    method: str
    name: str


def method_findings(method_id: str, workers: int = 2) -> Iterator[Finding]:
    """All findings about a method. Raises BadInput for an unknown one."""
    find_method(method_id)
    yield _listing(method_id)
    names = [*CHECKS, *EXTREMES]
    found: dict[str, Finding] = {}
    checks = (Check(method_id, name) for name in names)
    for check, result in run_tasks(checks, judge, workers, LIMITS):
        found[check.name] = _of_worker(check.name, result)
    for name in names:
        yield found[name]
    yield _elsewhere(method_id)


def _of_worker(name: str, result: Finding | Lost) -> Finding:
    return Finding(False, name, result.reason) if isinstance(result, Lost) else result


def judge(check: Check) -> Finding:
    """What a check finds; in a worker."""
    if check.name in EXTREMES:
        return tried(check.name, lambda: _extreme(check))
    return tried(check.name, lambda: CHECKS[check.name](check.method))


def _listing(method_id: str) -> Finding:
    """`bench list` looks at the entry points of all methods, and loads none."""
    start = time.perf_counter()
    done = subprocess.run(own_python("-c", LISTING), capture_output=True, text=True, check=False)
    seconds = time.perf_counter() - start
    if done.returncode or method_id.partition("@")[0] not in done.stdout:
        return Finding(False, "bench list", f"does not name it: {done.stderr.strip()[-200:]}")
    heavy = sorted(set(HEAVY) & set(done.stderr.split()))
    if heavy:
        return Finding(
            False, "bench list", f"loads {', '.join(heavy)}; import them where they are needed"
        )
    return Finding(True, "bench list", f"{seconds:.1f} s, loads no heavy package")


def _renderer(method_id: str) -> Renderer:
    return load_renderer(method_id, "auto")


def _cloud() -> PointCloud:
    return ProceduralObject("chair", "validation", 0).cloud(generator("contract"))


def _images(method_id: str, views: Sequence[View] = VIEWS) -> UInt8Images:
    """As a run draws them, with the same random numbers each time."""
    method, renderer = find_method(method_id), _renderer(method_id)
    return draw(method, renderer, _cloud(), views, generator("contract", "method")).images


def _loads(method_id: str) -> str:
    start = time.perf_counter()
    renderer = _renderer(method_id)
    for name in ("prepare", "draw"):
        if not callable(getattr(renderer, name, None)):
            raise Broken(f"{type(renderer).__name__} has no function {name}")
    return f"{time.perf_counter() - start:.1f} s"


def _draws(method_id: str) -> str:
    method, renderer, rng = find_method(method_id), _renderer(method_id), generator("contract")
    cloud = seen_by(method, _cloud())
    before = cloud.points.copy()
    images = renderer.draw(renderer.prepare(cloud, rng), VIEWS, rng)
    if not isinstance(images, np.ndarray) or images.dtype != np.float32:
        found = getattr(images, "dtype", type(images).__name__)
        raise Broken(f"images are {found}, expected float32")
    expected = (len(VIEWS), IMAGE_SIZE, IMAGE_SIZE, 3)
    if images.shape != expected:
        raise Broken(f"images have the shape {images.shape}, expected {expected}")
    if not np.isfinite(images).all():
        raise Broken(f"{int((~np.isfinite(images)).sum())} values are not finite")
    if images.min() < 0 or images.max() > 1:
        raise Broken(f"values are in {images.min():.3g} .. {images.max():.3g}, expected 0 .. 1")
    if not np.array_equal(before, cloud.points):
        raise Broken("the points of the cloud were changed; work on a copy")
    _images(method_id)  # as a run does, which refuses blank ones
    return f"{list(images.shape)} float32 in {images.min():.2f} .. {images.max():.2f}"


def _no_views(method_id: str) -> str:
    renderer, rng = _renderer(method_id), generator("contract")
    images = renderer.draw(renderer.prepare(_cloud(), rng), (), rng)
    if np.shape(images) != (0, IMAGE_SIZE, IMAGE_SIZE, 3):
        raise Broken(f"gives {np.shape(images)}, expected (0, {IMAGE_SIZE}, {IMAGE_SIZE}, 3)")
    return "an empty array"


def _repeats(method_id: str) -> str:
    first, second = _images(method_id), _images(method_id)
    if not np.array_equal(first, second):
        raise Broken(f"{_apart(first, second)}; take all randomness from `rng`")
    return "the same bytes"


def _views_apart(method_id: str) -> str:
    alone = np.concatenate([_images(method_id, views=[view]) for view in VIEWS])
    together = _images(method_id)
    if _worst(alone, together) > 1:
        raise Broken(f"{_apart(alone, together)}; an image may not depend on the other views")
    return f"at most {_worst(alone, together)} grey levels between alone and together"


def _costs(method_id: str) -> str:
    views = [View(18.0 * i - 180, 0.0) for i in range(RUN_VIEWS)]
    start = time.perf_counter()
    _images(method_id, views=views)
    seconds = time.perf_counter() - start
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**10  # kB on Linux
    return f"a cloud with {RUN_VIEWS} views {seconds:.2f} s, {peak:.0f} MiB at most so far"


CHECKS: Mapping[str, Callable[[str], str]] = {
    "loading": _loads,
    "images": _draws,
    "no views": _no_views,
    "repeatable": _repeats,
    "views apart": _views_apart,
    "cost": _costs,
}


def _extreme(check: Check) -> str:
    """Images as always, or a refusal that names the stage."""
    cloud = EXTREMES[check.name].apply(_cloud(), generator("contract", check.name))
    method, renderer = find_method(check.method), _renderer(check.method)
    cloud = seen_by(method, cloud)
    rng = generator("contract", "method")
    try:
        images = renderer.draw(renderer.prepare(cloud, rng), VIEWS[:1], rng)
    except (StageFailure, BadInput) as refusal:
        return f"refused: {reason_of(refusal)}"
    except Exception as error:
        raise Broken(f"{reason_of(error)}; raise StageFailure(stage, problem)") from error
    if np.shape(images) != (1, IMAGE_SIZE, IMAGE_SIZE, 3) or not np.isfinite(images).all():
        raise Broken("drawn, with a wrong shape or values that are not finite")
    return "drawn"


def draw_alone(method_id: str) -> UInt8Images:
    """Images for a comparison between processes; in a worker."""
    return _images(method_id)


def _elsewhere(method_id: str) -> Finding:
    """The same in another process, on two threads."""
    name, drawn = "processes and threads", []
    for threads in (1, 2):
        around = WORKER_ENVIRONMENT | thread_counts(threads) | {"PYTHONHASHSEED": str(threads)}
        try:
            ((_, images),) = run_tasks([method_id], draw_alone, 1, LIMITS, around)
        except Exception as error:  # whatever a stranger's method raises
            return Finding(False, name, reason_of(error))
        if isinstance(images, Lost):
            return Finding(False, name, images.reason)
        drawn.append(images)
    apart = _worst(*drawn)
    text = f"at most {apart} grey levels between two processes, on one thread and on two"
    return Finding(apart <= 1, name, text)


def _worst(a: UInt8Images, b: UInt8Images) -> int:
    return int(np.abs(a.astype(np.int16) - b).max())


def _apart(a: UInt8Images, b: UInt8Images) -> str:
    return f"{int((a != b).any(axis=-1).sum())} pixels differ, by up to {_worst(a, b)} grey levels"
