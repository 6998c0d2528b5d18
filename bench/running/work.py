"""The jobs of a run: what a worker does for one, and how results come into the store."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from functools import cache, lru_cache
from operator import attrgetter
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.catalogue.conditions import PluginPerturbation, find_condition
from bench.catalogue.method_files import PROJECT
from bench.catalogue.methods import FLOORS, Method, find_run_method, is_foreign
from bench.catalogue.metrics import (
    Extractor,
    extractor_of,
    find_extractor,
    lpips_network,
    metrics_device,
)
from bench.catalogue.suites import Limits
from bench.metrics.image_scores import scores
from bench.records.job import (
    CLAIMED,
    GROUND_TRUTH,
    IMAGES,
    Job,
    Result,
    failed,
    pack,
    pack_views,
    stored_text,
    timed,
    unpack,
)
from bench.records.store import Store
from bench.running.pool import TASKS_PER_WORKER, Executor, TaskPool, WorkerFailure, submit_all
from data_prep.clouds.conditions import Unchanged
from data_prep.clouds.far_points import note_on_scale
from data_prep.datasets.exported import UNPERTURBED, ExportedObject
from data_prep.failures import BadInput, MissingDependency, StageFailure
from data_prep.progress import log, progress
from data_prep.randomness import generator
from data_prep.rendering.images import to_uint8
from data_prep.scene import IMAGE_SIZE, CloudOrigin, PointCloud, Renderer, UInt8Images, View

_REFERENCES_KEPT = 4  # ground truths in memory: the jobs of an object follow each other


@dataclass(frozen=True, eq=False)
class _RenderedViews:
    """Images of a cloud, notes on the method's repairs, and its times as in a record."""

    images: UInt8Images
    notes: str = ""
    prepare_s: float | None = None
    draw_s: float | None = None
    # Of the job so far.
    timing: Mapping[str, float] = field(default_factory=dict)


def run_job(job: Job) -> Result:
    """Carry out a job. Whatever a method raises becomes failed records with the reason."""
    drawn = _draw_job(job)
    return _score_job(job, drawn) if isinstance(drawn, _RenderedViews) else drawn


def _draw_job(job: Job) -> _RenderedViews | Result:
    """Draw the images of a job; the result of one that fails."""
    seconds = dict[str, float]()
    try:
        if job.method != GROUND_TRUTH:
            drawn = _draw(job, seconds)
        else:
            with timed("rendering", seconds):
                drawn = _RenderedViews(job.object.truth(job.views))
    except BaseException as error:  # a method may call exit(), or raise KeyboardInterrupt
        drawn = _failed(job, error)
    return replace(drawn, timing=seconds)


def _score_job(job: Job, drawn: _RenderedViews) -> Result:
    """Return the result of a job whose images are drawn."""
    seconds = dict(drawn.timing)
    scored: dict[str, NDArray[np.float64]] = {}
    try:
        arrays, device = {IMAGES: pack(drawn.images)}, metrics_device(job.device)
        with timed("metrics", seconds):
            if job.reference is not None:
                truth = unpack(job.reference)
                scored |= scores(truth, drawn.images)
                if weights := dict(job.features).get(extractor_of("lpips")):
                    network = lpips_network(weights, device)
                    codes = map(network.encode, (truth, drawn.images))
                    scored["lpips"] = network.distance(*codes)
            for extractor, weights in job.features:
                arrays[extractor] = pack(_extractor(extractor, weights, device)(drawn.images))
        notes, views = stored_text(drawn.notes), pack_views(job.views, scored)
        times = drawn.prepare_s, drawn.draw_s
        result = Result(job.key, job.suite, "", notes, *times, views, arrays)
    except BaseException as error:
        result = _failed(job, error)
    return replace(result, timing=seconds)


def _foreign_code(job: Job) -> str:
    """Return what a job executes that is of others than this project; "" where that is nothing.

    Such code may change its process for all that comes after: it gets workers of its own, and none
    that scores.
    """
    foreign = [job.method] if is_foreign(job.method) else []
    if isinstance(job.perturbation, PluginPerturbation):
        foreign.append(job.condition)
    module = type(getattr(job.object, "original", job.object)).__module__
    if module.partition(".")[0] not in PROJECT:
        foreign.append(module)
    return " ".join(foreign)


def _failed(job: Job, error: BaseException) -> Result:
    reason = reason_of(error)
    if not isinstance(error, MissingDependency):
        return failed(job, reason)
    return _unusable(job, reason.partition(": ")[2])


def _unusable(job: Job, reason: str) -> Result:
    result = failed(job, reason)
    return replace(result, unusable=result.reason)


def reason_of(error: BaseException) -> str:
    """Return an exception as the reason in a record, as in "ball-pivoting: no faces"."""
    name = type(error).__name__
    try:
        text = str(error)
        if isinstance(error, BadInput | StageFailure):
            return f"input: {text}" if isinstance(error, BadInput) else text
        line = (text.splitlines() or ["no message"])[0]
        # A MemoryError is refused at once: nothing was used up yet.
        return f"memory: {line}" if isinstance(error, MemoryError) else f"{name}: {line}"
    except BaseException:  # its text is made by code of others, too
        return f"{name}: its message cannot be shown"


def _draw(job: Job, seconds: dict[str, float]) -> _RenderedViews | Result:
    address = job.address or job.method
    method = find_run_method(address)
    try:
        with timed("methods", seconds):
            renderer = load_renderer(address, job.device)
    except BadInput as error:  # unusable weights fail every job alike
        return _unusable(job, str(error))
    truth = None if job.reference is None else unpack(job.reference)
    seen = job
    if not method.sees_cloud and job.perturbation == Unchanged():  # one job for every condition
        seen = replace(job, condition=UNPERTURBED)
    cloud, rng = replace(cloud_of(seen), origin=_origin(job)), rng_of(seen)
    begun = time.perf_counter()
    try:
        with timed("methods", seconds):
            drawn = draw(method, renderer, cloud, job.views, rng, job.batch, truth)
    except MissingDependency:
        raise
    except BaseException as error:
        # Of images that were drawn elsewhere, the time to read them is no cost.
        taken_s = time.perf_counter() - begun if method.images is None else None
        return failed(job, reason_of(error), taken_s)
    scale = note_on_scale(cloud.points) if job.perturbation == Unchanged() else None
    return replace(drawn, notes="; ".join(filter(None, (drawn.notes, scale))))


def draw(
    method: Method,
    renderer: Renderer,
    cloud: PointCloud,
    views: Sequence[View],
    rng: np.random.Generator,
    batch: int | None = None,
    truth: UInt8Images | None = None,
    *,
    side: int = IMAGE_SIZE,
) -> _RenderedViews:
    """Draw a cloud, `batch` views a call (None: all of them), and check the images.

    Their side is one of `method.sizes`.

    Raises whatever the method raises, and StageFailure for anything but images, and for blank ones.
    """
    cloud = seen_by(method, cloud)
    start = time.perf_counter()
    state = renderer.prepare(cloud, rng)
    prepared = time.perf_counter()
    size = batch or len(views)
    batches = [views[i : i + size] for i in range(0, len(views), size)]
    of_size: dict[str, Any] = {} if side == IMAGE_SIZE else {"size": side}
    drawn = [renderer.draw(state, part, rng, **of_size) for part in batches]
    done = time.perf_counter()
    checked = (checked_images(i, len(part), side) for i, part in zip(drawn, batches, strict=True))
    images = np.concatenate([*checked])
    if method.id not in FLOORS:
        _refuse_blank(images, truth, len(cloud.points))
    if method.images is not None:  # reading them tells nothing about the method
        claims = method.images.claims
        return _RenderedViews(images, CLAIMED, claims.prepare_s, claims.draw_s)
    notes = "; ".join(getattr(state, "notes", ()))
    return _RenderedViews(images, notes, prepared - start, (done - prepared) / len(views))


def seen_by(method: Method, cloud: PointCloud) -> PointCloud:
    """Return the cloud as the method gets it: without mesh or origin where it is not to look."""
    source, origin = method.sees_mesh, method.images
    return PointCloud(
        cloud.points, cloud.source if source else None, cloud.origin if origin else None
    )


def _refuse_blank(images: UInt8Images, truth: UInt8Images | None, points: int) -> None:
    """Raise StageFailure where an image is of one colour throughout, unless the true one is."""

    def is_flat(images: UInt8Images) -> NDArray[np.bool_]:
        return (images == images[:, :1, :1]).all(axis=(1, 2, 3))

    # A renderer that has lost its context draws such images, or one that looks the wrong way.
    flat = is_flat(images) if truth is None else is_flat(images) & ~is_flat(truth)
    if flat.any():
        few = f"; {points} points are too few" if points < 32 else ""
        raise StageFailure("draw", f"{int(flat.sum())} of {len(flat)} images are blank{few}")


def cloud_of(job: Job) -> PointCloud:
    """Return the perturbed cloud, which depends on seed, object and condition only."""
    condition = job.condition
    stored = job.object.perturbed(condition) if isinstance(job.object, ExportedObject) else None
    if stored is not None:  # in a file, unless the dataset was made without that condition
        return stored
    sampled = job.object.cloud(generator(job.seed, "cloud", *job.name.object))
    return job.perturbation.apply(sampled, generator(job.seed, condition, *job.name.object))


def cloud_under(job: Job, condition: str) -> PointCloud:
    """Return the cloud of a job's object under a condition, whatever its method sees."""
    change = find_condition(condition).perturbation
    return cloud_of(replace(job, condition=condition, perturbation=change))


def _origin(job: Job) -> CloudOrigin:
    views = job.object.exported_views if isinstance(job.object, ExportedObject) else job.views
    return CloudOrigin(job.condition, *job.name.object, views)


def rng_of(job: Job) -> np.random.Generator:
    """Return the source of random numbers for the method of a job."""
    return generator(job.seed, "method", job.method, job.condition, *job.name.object)


def checked_images(images: NDArray[np.float32], count: int, side: int = IMAGE_SIZE) -> UInt8Images:
    """Return images of `count` views as bytes. Raises StageFailure for anything but images."""
    expected = (count, side, side, 3)
    if not isinstance(images, np.ndarray) or images.dtype.kind != "f":
        kind = getattr(images, "dtype", type(images).__name__)
        raise StageFailure("draw", f"images are {kind}, expected float32 in [0, 1]")
    if images.shape != expected:
        raise StageFailure("draw", f"images of shape {images.shape}, expected {expected}")
    bad = int((~np.isfinite(images)).sum())
    if bad:
        raise StageFailure("draw", f"{bad} pixel values are not finite")
    return to_uint8(images)


@cache
def load_renderer(address: str, device: str) -> Renderer:
    """Return the renderer of a method, loaded once a process; unusable weights are refused."""
    return find_run_method(address).load(device)


@cache
def _extractor(name: str, weights: str, device: str) -> Extractor:
    return find_extractor(name).load(weights, device)


@dataclass(frozen=True, eq=False)
class _Step:
    """A job, or what is left of one whose images were drawn in the company of foreign code."""

    job: Job
    company: str
    drawn: _RenderedViews | None = None

    def do(self) -> Result | _RenderedViews:
        if self.drawn is not None:
            return _score_job(self.job, self.drawn)
        return _draw_job(self.job) if self.company else run_job(self.job)


class JobPool:
    """An executor (`bench.running.pool`) of jobs in worker processes of this machine.

    At most `workers` of them are at work, and not more than there are jobs to come (`count`). A job
    that takes more than its limits or whose process dies becomes failed records; one that takes too
    long is tried once more before. The code of others draws in workers of its own, and the images
    are scored in ours.
    """

    def __init__(
        self, count: int, workers: int, limits: Limits, tasks_per_worker: int = TASKS_PER_WORKER
    ) -> None:
        more = {"tasks_per_worker": tasks_per_worker, "company": attrgetter("company")}
        self._pool: TaskPool[_Step, Any] = TaskPool(_Step.do, min(workers, count), limits, **more)
        self.capacity = self._pool.capacity
        self._late: set[str] = set()

    def submit(self, job: Job) -> None:
        """Start a job; at most `capacity` may be under way."""
        self._pool.submit(_Step(job, _foreign_code(job)))

    def wait_any(self, timeout_s: float | None = None) -> Iterator[Result]:
        """Wait until jobs have ended, and yield the result of each; nothing after `timeout_s`."""
        for step, result in self._pool.wait_any(timeout_s):
            is_late = isinstance(result, WorkerFailure) and result.kind == "timeout"
            if isinstance(result, _RenderedViews):  # it goes on by another step
                obj = step.job.object  # what executes the code of others is left behind
                named: Any = SimpleNamespace(class_name=obj.class_name, object_id=obj.object_id)
                job = replace(step.job, object=named, perturbation=Unchanged())
                self._pool.submit(_Step(job, "", result))
            elif is_late and step.job.key not in self._late:
                self._late.add(step.job.key)  # the machine may have been busy
                self._pool.submit(step)
            elif isinstance(result, WorkerFailure):
                yield failed(step.job, result.reason, result.taken_s)
            else:
                yield result

    def close(self) -> None:
        """Stop all workers at once."""
        self._pool.close()


def run_jobs(
    jobs: Sequence[Job],
    store: Store,
    title: str,
    start: Callable[[int], Executor],
) -> dict[str, Result]:
    """Do the jobs that the store does not have yet, and return the results of all, by key."""
    done = store.find([job.key for job in jobs])
    missing = [job for job in jobs if job.key not in done]
    if not missing:
        return done
    if done:
        log(f"{title}: {len(done)} of {len(jobs)} are there from before")
    failures = 0
    with (
        progress(title, len(missing)) as advance,
        closing(do_and_store(missing, len(missing), store, start)) as stream,
    ):
        for result in stream:
            done[result.key] = result
            failures += not result.has_images
            advance(failures)
    return done


def do_and_store(
    jobs: Iterable[Job | None],
    count: int,
    store: Store,
    start: Callable[[int], Executor],
    left_s: Callable[[], float | None] = lambda: None,
) -> Generator[Result, None, None]:
    """Do jobs, at most `count`, and yield each result, without contents, when the store has it.

    `jobs` and `left_s` are as in `submit_all`, `start` gives the executor for a number of jobs; it
    is closed here. Raises MissingDependency where going on makes no sense, and BadInput where a
    ground truth has changed since it was drawn.
    """
    read = lru_cache(_REFERENCES_KEPT)(store.array)
    ready = (
        replace(job, reference=read(job.reference_key)) if job and job.reference_key else job
        for job in jobs
    )
    with closing(start(count)) as executor, closing(submit_all(ready, executor, left_s)) as stream:
        for result in stream:
            if result.unusable:
                raise MissingDependency(result.unusable)
            store.append(result)
            yield replace(result, views=b"", arrays={})
