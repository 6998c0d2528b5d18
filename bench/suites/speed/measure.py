"""The worker of the suite `speed`, which times one method in a process that does nothing else.

It times loading (imports and weights), the first cloud and the first image in the fresh process;
then, after a round that does not count, rounds over all clouds, prepare and draw apart.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np

from bench.catalogue import suites
from bench.catalogue.methods import Method, find_method
from bench.catalogue.suites import Limits, Procedure
from bench.running.plan import views_of
from bench.running.work import draw, reason_of
from data_prep.clouds.conditions import Perturbation
from data_prep.datasets.registry import SceneObject
from data_prep.failures import BadInput, MissingDependency, StageFailure
from data_prep.files.atomic_write import write_whole
from data_prep.files.safe_read import MIB, read_file
from data_prep.randomness import generator
from data_prep.scene import PointCloud, Renderer, View

_Returned = TypeVar("_Returned")


LIMITS = Limits(time_s=600.0, memory_gib=8.0)


@dataclass(frozen=True)
class SpeedSuite(Procedure):
    """The cost of images, which `bench.suites.speed.run` measures.

    Each method is timed in a process of its own for each number of threads.
    """

    # All others are compared with these; the first is the paper's.
    baselines: tuple[str, ...] = ("surface-apss", "surface-fit")
    conditions: tuple[str, ...] = ("2048",)
    class_name: str = "chair"
    # As many as an interval over objects needs. Reconstruction takes seconds a cloud: three rounds
    # leave the whole run at some minutes. What takes milliseconds goes on for `seconds`, so that
    # its median is over more than chance, but not beyond `most_rounds`.
    clouds: int = 8
    views: int = 20  # of each cloud, drawn in one call
    singles: int = 5  # views that are also drawn one by one, in each round
    # Rounds over all clouds that do not count. One: after it libraries have chosen their algorithms
    # for both sizes of a call, and memory is mapped; later rounds were no faster.
    warm_ups: int = 1
    least_rounds: int = 3  # that count
    most_rounds: int = 100
    seconds: float = 3.0  # after which no round begins, once there are `least_rounds`
    amortised: tuple[int, ...] = (1, 2, 5, 10, 20, 50, 100, 500)  # views of the cost an image
    quiet_cores: float = 0.25  # more than these busy with something else: a mark beside the times
    limits: Limits = LIMITS  # of one measurement


SPEED = SpeedSuite(**vars(suites.SPEED))


FORM = 1  # of the files; part of their keys
MOST_BYTES = 64 * MIB

_Stage = Literal["load", "prepare", "draw"]


@dataclass(frozen=True)
class TimingSample:
    """A timed call."""

    cloud: str  # its object, "chair/test-0000"; empty for "load", which needs none
    round: int  # 0 for the first call of its kind in its process, cold; from 1 on warm
    stage: _Stage
    views: int  # drawn in the call; 0 for other stages
    wall_s: float  # seconds by the clock
    core_s: float  # seconds of processor time of the whole process, all threads together


@dataclass(frozen=True)
class CloudFailure:
    """A cloud that a method failed on, and the reason."""

    cloud: str
    reason: str


@dataclass(frozen=True)
class Measurement:
    """A method with a number of threads under a condition, in a process of its own.

    The last three are None where the process died.
    """

    key: str  # names everything that the times depend on
    method: str
    condition: str
    threads: int
    views: int  # the larger of the two batches
    clouds: int  # those in `failures` were not drawn, or not to the end
    device: str  # "cpu", or the name of the GPU that was used
    samples: tuple[TimingSample, ...]
    failures: tuple[CloudFailure, ...]
    idle_mib: float | None = None  # peak resident memory before the method was loaded
    peak_mib: float | None = None  # peak resident memory at the end
    elsewhere_cores: float | None = None  # mean number that other processes kept busy meanwhile


def measurement_path(directory: Path, key: str) -> Path:
    """Return the path of a key's measurement."""
    return directory / "measurements" / f"{key}.json"


def write_measurement(directory: Path, measurement: Measurement) -> None:
    """Write a measurement to disk; when this returns, a power cut cannot take it back."""
    text = json.dumps({"form": FORM} | asdict(measurement), ensure_ascii=False)
    write_whole(measurement_path(directory, measurement.key), text.encode())


def read_measurement(directory: Path, key: str) -> Measurement | None:
    """Return the measurement of a key; None where no usable one exists."""
    path = measurement_path(directory, key)
    if not path.is_file():
        return None
    try:
        fields: dict[str, Any] = json.loads(read_file(path, MOST_BYTES))
        if fields.pop("form") != FORM or fields["key"] != key:
            return None
        fields["samples"] = tuple(TimingSample(**sample) for sample in fields["samples"])
        fields["failures"] = tuple(CloudFailure(**failure) for failure in fields["failures"])
        return Measurement(**fields)
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None


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


_CLOCK = Clock(time.perf_counter, time.process_time, finish_gpu)


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
        method, lambda: method.load(unit.device), subjects, unit.suite, _CLOCK
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
    names = (f"{obj.class_name}/{obj.object_id}" for obj in unit.objects)
    return Measurement(
        *(unit.key, unit.method, unit.condition, unit.threads, unit.views),
        clouds=len(unit.objects),
        device=unit.device,
        samples=(),
        failures=tuple(CloudFailure(name, reason) for name in names),
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

    def timed(
        call: Callable[[], _Returned], cloud: str, number: int, stage: _Stage, views: int = 0
    ) -> _Returned:
        clock.finish()
        core, wall = clock.core(), clock.wall()
        value = call()
        clock.finish()
        wall_s, core_s = clock.wall() - wall, clock.core() - core
        samples.append(TimingSample(cloud, number, stage, views, wall_s, core_s))
        return value

    def prepare_and_draw(subject: Subject, number: int, calls: Sequence[Sequence[View]]) -> None:
        rng = subject.rng()
        cloud = subject.cloud if method.sees_mesh else PointCloud(subject.cloud.points)
        state = timed(partial(renderer.prepare, cloud, rng), subject.id, number, "prepare")
        for views in calls:
            draw_all = partial(renderer.draw, state, views, rng)
            timed(draw_all, subject.id, number, "draw", len(views))

    @contextmanager
    def left_out_if_failed(subject: Subject) -> Iterator[None]:
        try:
            yield
        except MissingDependency:
            raise
        except (Exception, SystemExit) as error:
            failures.append(CloudFailure(subject.id, reason_of(error)))
            left.remove(subject)

    try:
        renderer = timed(load, "", 0, "load")
    except (BadInput, MissingDependency):
        raise
    except (Exception, SystemExit) as error:  # a method may call exit()
        return [], [CloudFailure(subject.id, reason_of(error)) for subject in subjects]
    for subject in left[:1]:
        with left_out_if_failed(subject):
            prepare_and_draw(subject, 0, [subject.views[:1]])
    for _ in range(suite.warm_ups):
        for subject in tuple(left):
            with left_out_if_failed(subject):
                # Blank images would be fast: the check raises for them.
                draw(method, renderer, subject.cloud, subject.views, subject.rng())
    start, number = clock.wall(), 0
    while left and number < suite.most_rounds:
        if number >= suite.least_rounds and clock.wall() - start >= suite.seconds:
            break
        number += 1
        for subject in tuple(left):
            with left_out_if_failed(subject):
                views = subject.views
                calls = [*([view] for view in views[: suite.singles])]
                prepare_and_draw(subject, number, calls + ([views] if len(views) > 1 else []))
    return samples, failures


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
