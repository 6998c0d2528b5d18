"""The worker of the suite `speed`, which times one method in a process that does nothing else.

It times loading (imports and weights), the first cloud and the first image in the fresh process;
then, after a round that does not count, rounds over all clouds, prepare and draw apart.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from bench.catalogue.methods import Method, find_method
from bench.running.plan import views_of
from bench.running.work import draw, reason_of
from bench.suites.speed.samples import CloudFailure, Measurement, Stage, TimingSample
from bench.suites.speed.suite import SpeedSuite
from data_prep.clouds.conditions import Perturbation
from data_prep.datasets.registry import SceneObject
from data_prep.failures import BadInput, MissingDependency, StageFailure
from data_prep.randomness import generator
from data_prep.scene import PointCloud, Renderer, View

Returned = TypeVar("Returned")


@dataclass(frozen=True)
class Unit:
    """A measurement to be taken, as a plain value that crosses process boundaries."""

    key: str  # names everything that the times depend on
    suite: SpeedSuite
    method: str
    condition: str
    perturbation: Perturbation
    objects: tuple[SceneObject, ...]
    threads: int
    views: int  # of each cloud, drawn in one call and some of them one by one
    seed: int
    device: str


@dataclass(frozen=True, eq=False)
class Subject:
    """A cloud with the views to draw of it."""

    id: str
    cloud: PointCloud
    views: tuple[View, ...]
    rng: Callable[[], np.random.Generator]  # a new one each time: each round has the same work


@dataclass(frozen=True)
class Clock:
    """The sources of times, in seconds."""

    wall: Callable[[], float]  # by the clock
    core: Callable[[], float]  # processor time of this process, all threads
    finish: Callable[[], None]  # returns when the device has done all its work


def finish_gpu(modules: Mapping[str, Any] = sys.modules) -> None:
    """Wait for a GPU that this process uses: calls return before their work is done."""
    torch = modules.get("torch")
    if torch is not None and torch.cuda.is_initialized():
        torch.cuda.synchronize()


CLOCK = Clock(time.perf_counter, time.process_time, finish_gpu)


def peak_mib() -> float | None:
    """Return the peak resident memory of this process in MiB; None without Linux's /proc."""
    # Not `ru_maxrss`, which starts with the memory of the parent process.
    try:
        lines = Path("/proc/self/status").read_text(encoding="utf-8").splitlines()
    except OSError:
        return None
    peaks = [line.split()[1] for line in lines if line.startswith("VmHWM:")]
    return int(peaks[0]) / 1024 if peaks else None


def measure(unit: Unit, peak_mib: Callable[[], float | None] = peak_mib) -> Measurement:
    """Take a measurement; exceptions of the method become failures with the reason.

    Raises BadInput for weights that cannot be used, MissingDependency where a library is missing.
    """
    busy, cpu_start, start = _busy_s(), time.process_time(), time.perf_counter()
    subjects, unusable = subjects_of(unit)
    idle_mib = peak_mib()
    method = find_method(unit.method)
    samples, failures = take_samples(
        method, lambda: method.load(unit.device), subjects, unit.suite, CLOCK
    )
    elsewhere_s = (_busy_s() - busy) - (time.process_time() - cpu_start)
    torch = sys.modules.get("torch")
    uses_gpu = torch is not None and torch.cuda.is_initialized()
    return replace(
        lost(unit, ""),
        device=torch.cuda.get_device_name() if torch is not None and uses_gpu else "cpu",
        samples=tuple(samples),
        failures=(*unusable, *failures),
        idle_mib=idle_mib,
        peak_mib=peak_mib(),
        elsewhere_cores=max(0.0, elsewhere_s / (time.perf_counter() - start)),
    )


def lost(unit: Unit, reason: str) -> Measurement:
    """Return the measurement of a process that died: no cloud has a time, each failed."""
    return Measurement(
        key=unit.key,
        method=unit.method,
        condition=unit.condition,
        threads=unit.threads,
        views=unit.views,
        clouds=len(unit.objects),
        device=unit.device,
        samples=(),
        failures=tuple(
            CloudFailure(f"{obj.class_name}/{obj.object_id}", reason) for obj in unit.objects
        ),
    )


def subjects_of(unit: Unit) -> tuple[list[Subject], list[CloudFailure]]:
    """Return the clouds of a unit, as other suites draw them, and those that failed to load."""
    subjects, failures = [], []
    for obj in unit.objects:
        names = (obj.class_name, obj.object_id)
        name = "/".join(names)
        try:
            cloud = obj.cloud(generator(unit.seed, "cloud", *names))
            cloud = unit.perturbation.apply(cloud, generator(unit.seed, unit.condition, *names))
        except (BadInput, StageFailure) as error:
            failures.append(CloudFailure(name, reason_of(error)))
            continue
        views = views_of(obj, unit.views, unit.seed)
        of_method = (unit.seed, "method", unit.method, unit.condition, *names)
        subjects.append(Subject(name, cloud, views, lambda key=of_method: generator(*key)))
    return subjects, failures


def take_samples(
    method: Method,
    load: Callable[[], Renderer],
    subjects: Sequence[Subject],
    suite: SpeedSuite,
    clock: Clock,
) -> tuple[list[TimingSample], list[CloudFailure]]:
    """Return times of loading, of the first image, and of `suite`'s rounds; and failures.

    A cloud that fails once is left out from then on; its times until then are kept. Where the
    method cannot be loaded, all clouds have failed.
    """
    samples: list[TimingSample] = []
    failures: list[CloudFailure] = []
    left = list(subjects)
    try:
        renderer, sample = _timed(load, clock, "", 0, "load")
    except (BadInput, MissingDependency):
        raise
    except (Exception, SystemExit) as error:  # a method may call exit()
        return [], [CloudFailure(subject.id, reason_of(error)) for subject in subjects]
    samples.append(sample)
    for subject in left[:1]:
        with _left_out_if_failed(subject, left, failures):
            _round(method, renderer, subject, 0, [subject.views[:1]], clock, samples)
    for _ in range(suite.warm_ups):
        for subject in tuple(left):
            with _left_out_if_failed(subject, left, failures):
                # Blank images would be fast: the check raises for them.
                draw(method, renderer, subject.cloud, subject.views, subject.rng())
    start, number = clock.wall(), 0
    while left and number < suite.most_rounds:
        if number >= suite.least_rounds and clock.wall() - start >= suite.seconds:
            break
        number += 1
        for subject in tuple(left):
            with _left_out_if_failed(subject, left, failures):
                views = subject.views
                calls = [*([view] for view in views[: suite.singles])]
                calls += [views] if len(views) > 1 else []
                _round(method, renderer, subject, number, calls, clock, samples)
    return samples, failures


@contextmanager
def _left_out_if_failed(
    subject: Subject, left: list[Subject], failures: list[CloudFailure]
) -> Iterator[None]:
    try:
        yield
    except MissingDependency:
        raise
    except (Exception, SystemExit) as error:
        failures.append(CloudFailure(subject.id, reason_of(error)))
        left.remove(subject)


def _timed(
    call: Callable[[], Returned],
    clock: Clock,
    cloud: str,
    number: int,
    stage: Stage,
    views: int = 0,
) -> tuple[Returned, TimingSample]:
    clock.finish()
    core, wall = clock.core(), clock.wall()
    value = call()
    clock.finish()
    wall_s, core_s = clock.wall() - wall, clock.core() - core
    return value, TimingSample(cloud, number, stage, views, wall_s, core_s)


def _round(
    method: Method,
    renderer: Renderer,
    subject: Subject,
    number: int,
    calls: Sequence[Sequence[View]],
    clock: Clock,
    samples: list[TimingSample],
) -> None:
    """Prepare a cloud and draw it, a call for each element of `calls`, and append all times."""
    rng = subject.rng()
    cloud = subject.cloud if method.sees_mesh else PointCloud(subject.cloud.points)
    prepare = partial(renderer.prepare, cloud, rng)
    state, sample = _timed(prepare, clock, subject.id, number, "prepare")
    samples.append(sample)
    for views in calls:
        draw_all = partial(renderer.draw, state, views, rng)
        _, sample = _timed(draw_all, clock, subject.id, number, "draw", len(views))
        samples.append(sample)


def _busy_s() -> float:
    """Return the seconds that all processes have kept the cores of this process busy."""
    import psutil

    # Not the load average, which for a minute still has the load of the measurement before.
    usable = os.sched_getaffinity(0)
    cores: list[Any] = psutil.cpu_times(percpu=True)
    # "user" includes the time of guests.
    kinds = ("user", "nice", "system", "irq", "softirq", "steal")
    return sum(
        getattr(core, kind, 0.0)
        for number, core in enumerate(cores)
        if number in usable
        for kind in kinds
    )
