"""The measurement of one method by the suite `speed`, in a process that does nothing else.

In the fresh process it times the method's loading (imports and weights), its first cloud and its
first image. A round over all clouds follows that does not count, and then rounds that do, in which
the preparation of each cloud and the drawing of its views are timed separately.
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
from bench.catalogue.conditions import stream_of
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


LIMITS = Limits(time_s=600.0, memory_gib=8.0)  # the limits of one measurement


@dataclass(frozen=True)
class SpeedSuite(Procedure):
    """The suite that measures what an image costs, see `bench.suites.speed.run`.

    Each method is timed in a process of its own for each number of threads.
    """

    # The methods with whose times all others are compared; the first is the paper's.
    baselines: tuple[str, ...] = ("surface-apss", "surface-fit")
    conditions: tuple[str, ...] = ("2048",)
    class_name: str = "chair"
    # The number of clouds, one of each object: as many as an interval over objects needs.
    clouds: int = 8
    views: int = 20  # the number of views of each cloud that are drawn in one call
    singles: int = 5  # how many of these views are also drawn one by one, in each round
    # The number of rounds over all clouds that do not count. One is enough: after it libraries have
    # chosen their algorithms for both sizes of a call, and memory is mapped; later rounds were no
    # faster.
    warm_ups: int = 1
    # The number of rounds that count. Reconstruction takes seconds for a cloud, and with three
    # rounds the whole run takes some minutes. Methods that take milliseconds go on until `seconds`
    # have passed, so that their median is of many samples, but not beyond `most_rounds`.
    least_rounds: int = 3
    most_rounds: int = 100
    seconds: float = 3.0
    # The numbers of views of a cloud for which the cost of an image is computed.
    amortised: tuple[int, ...] = (1, 2, 5, 10, 20, 50, 100, 500)
    # How many cores other programs may keep busy in the mean; above that the times get a mark.
    quiet_cores: float = 0.25
    limits: Limits = LIMITS


SPEED = SpeedSuite(**vars(suites.SPEED))


FORM = 1  # the version of the files' form, which is a part of their keys, too
MOST_BYTES = 64 * MIB  # the largest file of a measurement that is read

_Stage = Literal["load", "prepare", "draw"]


@dataclass(frozen=True)
class TimingSample:
    """A timed call."""

    cloud: str  # the object of the cloud, as in "chair/test-0000"; "" for "load", without a cloud
    round: int  # 0 for the first call of its kind in the process (cold), from 1 on for later ones
    stage: _Stage
    views: int  # the number of views drawn in the call; 0 for other stages
    wall_s: float  # seconds by the clock
    core_s: float  # seconds of processor time of the whole process, all threads together


@dataclass(frozen=True)
class CloudFailure:
    """A cloud that a method failed on, and the reason."""

    cloud: str
    reason: str


@dataclass(frozen=True)
class Measurement:
    """The times of a method under a condition with a number of threads, from one process.

    The last three entries are None where the process died.
    """

    key: str  # a checksum of everything that the times depend on
    method: str
    condition: str
    threads: int
    views: int  # how many views are drawn in one call, beside the calls that draw one
    clouds: int  # the number of clouds, with those in `failures`
    device: str  # "cpu", or the name of the GPU that was used
    samples: tuple[TimingSample, ...]
    failures: tuple[CloudFailure, ...]  # the clouds that were not drawn in all rounds
    idle_mib: float | None = None  # the peak resident memory before the method was loaded
    peak_mib: float | None = None  # the peak resident memory at the end
    elsewhere_cores: float | None = None  # how many cores other processes kept busy, in the mean


def measurement_path(directory: Path, key: str) -> Path:
    """Return the path of the file for the measurement with this key."""
    return directory / "measurements" / f"{key}.json"


def write_measurement(directory: Path, measurement: Measurement) -> None:
    """Write a measurement to disk; when this returns, a power cut cannot take it back."""
    text = json.dumps({"form": FORM} | asdict(measurement), ensure_ascii=False)
    write_whole(measurement_path(directory, measurement.key), text.encode())


def read_measurement(directory: Path, key: str) -> Measurement | None:
    """Return the stored measurement with this key; None where there is none that can be used."""
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

    key: str  # a checksum of everything that the times depend on
    suite: SpeedSuite
    method: str
    condition: str
    perturbation: Perturbation
    objects: tuple[SceneObject, ...]
    threads: int
    views: int  # the number of views of each cloud, drawn in one call and some also one by one
    seed: int
    device: str


@dataclass(frozen=True, eq=False)
class Subject:
    """A cloud with the views to draw of it."""

    id: str  # the object of the cloud, as in "chair/test-0000"
    cloud: PointCloud
    views: tuple[View, ...]
    # Returns a new source of the same random numbers, so that each round has the same work.
    rng: Callable[[], np.random.Generator]


@dataclass(frozen=True)
class Clock:
    """The sources of times, in seconds."""

    wall: Callable[[], float]  # returns the time by the clock
    core: Callable[[], float]  # returns the processor time of this process, all threads together
    finish: Callable[[], None]  # waits until the device has done all its work


def finish_gpu(modules: Mapping[str, Any] = sys.modules) -> None:
    """Wait until a GPU that this process uses has done its work.

    Without that a call returns before its work is done, and its time would be too short.
    """
    torch = modules.get("torch")
    if torch is not None and torch.cuda.is_initialized():
        torch.cuda.synchronize()


_CLOCK = Clock(time.perf_counter, time.process_time, finish_gpu)


def peak_mib() -> float | None:
    """Return the peak resident memory of this process in MiB; None without Linux's /proc."""
    # Read from /proc, because `ru_maxrss` of `resource` includes the parent process's memory.
    try:
        lines = Path("/proc/self/status").read_text(encoding="utf-8").splitlines()
    except OSError:
        return None
    peaks = [line.split()[1] for line in lines if line.startswith("VmHWM:")]
    return int(peaks[0]) / 1024 if peaks else None


def measure(unit: Unit, peak_mib: Callable[[], float | None] = peak_mib) -> Measurement:
    """Take a measurement in this process.

    Exceptions that the method raises become failures with the reason. Raises BadInput for weights
    that cannot be used, and MissingDependency where a library is missing.
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
    """Return the measurement for a process that died: there are no times, and each cloud failed."""
    names = (f"{obj.class_name}/{obj.object_id}" for obj in unit.objects)
    return Measurement(
        key=unit.key,
        method=unit.method,
        condition=unit.condition,
        threads=unit.threads,
        views=unit.views,
        clouds=len(unit.objects),
        device=unit.device,
        samples=(),
        failures=tuple(CloudFailure(name, reason) for name in names),
    )


def subjects_of(unit: Unit) -> tuple[list[Subject], list[CloudFailure]]:
    """Return the clouds to be timed, and a failure for each cloud that cannot be made.

    They are the clouds that other suites draw of these objects with the same seed.
    """
    subjects, failures = [], []
    for obj in unit.objects:
        names = (obj.class_name, obj.object_id)
        name = "/".join(names)
        try:
            cloud = obj.cloud(generator(unit.seed, "cloud", *names))
            stream = stream_of(unit.condition, unit.perturbation)
            cloud = unit.perturbation.apply(cloud, generator(unit.seed, stream, *names))
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
    """Time a method, and return the times and the failures.

    Timed are the loading of the method, its first cloud with the first view, and the rounds of the
    suite. A cloud that fails once is left out of later rounds; its times until then are kept. Where
    the method cannot be loaded, all clouds have failed.
    """
    samples: list[TimingSample] = []
    failures: list[CloudFailure] = []
    left = list(subjects)

    def timed(
        call: Callable[[], _Returned], cloud: str, number: int, stage: _Stage, views: int = 0
    ) -> _Returned:
        """Return what the call returns, and add its times to the samples."""
        clock.finish()
        core, wall = clock.core(), clock.wall()
        value = call()
        clock.finish()
        wall_s, core_s = clock.wall() - wall, clock.core() - core
        samples.append(TimingSample(cloud, number, stage, views, wall_s, core_s))
        return value

    def prepare_and_draw(subject: Subject, number: int, calls: Sequence[Sequence[View]]) -> None:
        """Time the preparation of a cloud, and then the drawing of the views of each call."""
        rng = subject.rng()
        cloud = subject.cloud if method.sees_mesh else PointCloud(subject.cloud.points)
        state = timed(partial(renderer.prepare, cloud, rng), subject.id, number, "prepare")
        for views in calls:
            draw_all = partial(renderer.draw, state, views, rng)
            timed(draw_all, subject.id, number, "draw", len(views))

    @contextmanager
    def left_out_if_failed(subject: Subject) -> Iterator[None]:
        """Leave a cloud out of all further rounds where the block raises an exception."""
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
                # `draw` refuses blank images, whose times would be too good.
                draw(method, renderer, subject.cloud, subject.views, subject.rng())
    start, number = clock.wall(), 0
    while left and number < suite.most_rounds:
        if number >= suite.least_rounds and clock.wall() - start >= suite.seconds:
            break
        number += 1
        for subject in tuple(left):
            with left_out_if_failed(subject):
                calls: list[Sequence[View]] = [[view] for view in subject.views[: suite.singles]]
                if len(subject.views) > 1:
                    calls.append(subject.views)
                prepare_and_draw(subject, number, calls)
    return samples, failures


def _busy_s() -> float:
    """Return how many seconds the cores that this process may use have been busy since the start.

    The seconds of all these cores are added up, whichever process has kept them busy.
    """
    import psutil

    # The load average would be simpler, but it covers the last minute, and so earlier measurements.
    usable = os.sched_getaffinity(0)
    cores: list[Any] = psutil.cpu_times(percpu=True)
    # "user" includes "guest", the time of virtual machines, which is not added again.
    kinds = ("user", "nice", "system", "irq", "softirq", "steal")
    return sum(
        getattr(core, kind, 0.0)
        for number, core in enumerate(cores)
        if number in usable
        for kind in kinds
    )
