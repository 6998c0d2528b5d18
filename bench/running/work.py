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

from bench.catalogue.conditions import PluginPerturbation, find_condition, stream_of
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
from bench.running.colours import Keeper, coverage_of, in_colours, is_painted
from bench.running.pool import TASKS_PER_WORKER, Executor, TaskPool, WorkerFailure, submit_all
from data_prep.clouds.conditions import Unchanged
from data_prep.clouds.far_points import note_on_scale
from data_prep.datasets.exported import UNPERTURBED, ExportedObject
from data_prep.failures import BadInput, MissingDependency, StageFailure
from data_prep.progress import log, progress
from data_prep.randomness import generator
from data_prep.rendering.images import to_uint8
from data_prep.scene import IMAGE_SIZE, CloudOrigin, PointCloud, Renderer, UInt8Images, View

# How many ground truths the main process keeps in memory, so that not each job reads its own from
# the store. Few are enough: the jobs of an object follow each other.
_REFERENCES_KEPT = 4


@dataclass(frozen=True, eq=False)
class _RenderedViews:
    """The images that a job has drawn of its cloud, before they are scored."""

    images: UInt8Images
    notes: str = ""  # what the method says about its repairs of the cloud, "; " between them
    prepare_s: float | None = None  # seconds for the cloud; None for the ground truth
    draw_s: float | None = None  # seconds for an image; None for the ground truth
    # The seconds that the job has taken until now, by the parts of `Result.timing`.
    timing: Mapping[str, float] = field(default_factory=dict)


def run_job(job: Job) -> Result:
    """Carry out a job, and return its result.

    Whatever a method raises makes a result without images, with the reason.
    """
    drawn = _draw_job(job)
    return _score_job(job, drawn) if isinstance(drawn, _RenderedViews) else drawn


def _draw_job(job: Job) -> _RenderedViews | Result:
    """Draw the images of a job, and return them, or the result of the job where it fails."""
    seconds = dict[str, float]()
    try:
        if job.method != GROUND_TRUTH:
            drawn = _draw(job, seconds)
        else:
            with timed("rendering", seconds):
                drawn = _RenderedViews(job.object.truth(job.views))
    except BaseException as error:  # not only Exception: a method may call exit()
        drawn = _failed(job, error)
    return replace(drawn, timing=seconds)


def _score_job(job: Job, drawn: _RenderedViews) -> Result:
    """Score the images that a job has drawn, and return the result of the job.

    Images are scored against the ground truth where the job comes with it, and features are taken
    of them in any case.
    """
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
                    true_codes, drawn_codes = network.encode(truth), network.encode(drawn.images)
                    scored["lpips"] = network.distance(true_codes, drawn_codes)
            for extractor, weights in job.features:
                arrays[extractor] = pack(_extractor(extractor, weights, device)(drawn.images))
        result = Result(
            key=job.key,
            suite=job.suite,
            reason="",
            notes=stored_text(drawn.notes),
            prepare_s=drawn.prepare_s,
            draw_s=drawn.draw_s,
            views=pack_views(job.views, scored),
            arrays=arrays,
        )
    except BaseException as error:
        result = _failed(job, error)
    return replace(result, timing=seconds)


def _foreign_code(job: Job) -> str:
    """Return the names of the code that a job executes and that is not of this project.

    It is "" where all code is ours. Code of others may change its process for all jobs that come
    after. So jobs that execute the same code share workers, which do nothing else, and the scores
    are taken in other processes.
    """
    foreign = [job.method] if is_foreign(job.method) else []
    if isinstance(job.perturbation, PluginPerturbation):
        foreign.append(job.condition)
    module = type(getattr(job.object, "original", job.object)).__module__
    if module.partition(".")[0] not in PROJECT:
        foreign.append(module)
    return " ".join(foreign)


def _failed(job: Job, error: BaseException) -> Result:
    """Return the result of a job that an exception has ended."""
    reason = reason_of(error)
    if not isinstance(error, MissingDependency):
        return failed(job, reason)
    return _unusable(job, reason.partition(": ")[2])


def _unusable(job: Job, reason: str) -> Result:
    """Return the result of a job that fails for a reason that ends the whole run."""
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
        # The reason is of the same kind as that of a worker killed for its use of memory.
        return f"memory: {line}" if isinstance(error, MemoryError) else f"{name}: {line}"
    except BaseException:  # even the text of an exception is made by code of others
        return f"{name}: its message cannot be shown"


def _draw(job: Job, seconds: dict[str, float]) -> _RenderedViews | Result:
    """Draw the cloud of a job by its method, and return the images, or the result of a failure.

    The seconds that the method takes are added to `seconds["methods"]`.
    """
    address = job.address or job.method
    method = find_run_method(address)
    try:
        with timed("methods", seconds):
            renderer = load_renderer(address, job.device)
    except BadInput as error:  # weights that cannot be used: all jobs of the method would fail
        return _unusable(job, str(error))
    truth = None if job.reference is None else unpack(job.reference)
    seen = job
    if not method.sees_cloud and job.perturbation == Unchanged():
        # This job stands for all conditions, so its cloud must not depend on the one it names.
        seen = replace(job, condition=UNPERTURBED)
    cloud, rng = replace(cloud_of(seen), origin=_origin(job)), rng_of(seen)
    begun = time.perf_counter()
    try:
        with timed("methods", seconds):
            drawn = _draw_in_colours(method, renderer, cloud, job.views, rng, job.batch, truth)
    except MissingDependency:
        raise
    except BaseException as error:
        # Where images were drawn elsewhere, the time to read them is no cost of the method.
        taken_s = time.perf_counter() - begun if method.images is None else None
        return failed(job, reason_of(error), taken_s)
    scale = note_on_scale(cloud.points) if job.perturbation == Unchanged() else None
    return replace(drawn, notes="; ".join(filter(None, (drawn.notes, scale))))


def _draw_in_colours(
    method: Method,
    renderer: Renderer,
    cloud: PointCloud,
    views: Sequence[View],
    rng: np.random.Generator,
    batch: int | None,
    truth: UInt8Images | None,
) -> _RenderedViews:
    """Draw as `draw` does, and paint grey images in the colours of a cloud that has some.

    Painting is a part of the time that an image takes.
    """
    if not is_painted(method, cloud):
        return draw(method, renderer, cloud, views, rng, batch, truth)
    keeper = Keeper(renderer)
    drawn = draw(method, keeper, cloud, views, rng, batch, truth)
    start = time.perf_counter()
    coverage, notes = coverage_of(keeper, method, drawn.images, views, batch or len(views))
    images = in_colours(drawn.images, coverage.clip(0, 1), cloud, views)
    painted_s = (time.perf_counter() - start) / len(views)
    told = "; ".join(filter(None, (drawn.notes, *notes)))
    return replace(drawn, images=images, notes=told, draw_s=(drawn.draw_s or 0) + painted_s)


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
    """Draw a cloud, check the images, and return them with the times that they took.

    batch  how many views are drawn in one call; None for all of them
    truth  the true images, uint8 [V, H, W, 3], where there are any: a blank image is no failure
           where the true one is blank, too
    side   the width and height of the images in pixels, one of `method.sizes`

    Raises whatever the method raises, and StageFailure for anything but images, and for blank ones.
    """
    cloud = seen_by(method, cloud)
    start = time.perf_counter()
    state = renderer.prepare(cloud, rng)
    prepared = time.perf_counter()
    size = batch or len(views)
    batches = [views[i : i + size] for i in range(0, len(views), size)]
    # Renderers that draw in one size only take no argument for it.
    size_argument: dict[str, Any] = {} if side == IMAGE_SIZE else {"size": side}
    drawn = [renderer.draw(state, part, rng, **size_argument) for part in batches]
    done = time.perf_counter()
    checked = []
    for images_of_part, part in zip(drawn, batches, strict=True):
        checked.append(checked_images(images_of_part, len(part), side))
    images = np.concatenate(checked)
    if method.id not in FLOORS:
        _refuse_blank(images, truth, len(cloud.points))
    if method.images is not None:
        # The images were drawn elsewhere: the time to read them says nothing about the method, so
        # the times are those that its author claims.
        claims = method.images.claims
        return _RenderedViews(images, CLAIMED, claims.prepare_s, claims.draw_s)
    notes = "; ".join(getattr(state, "notes", ()))
    return _RenderedViews(images, notes, prepared - start, (done - prepared) / len(views))


def seen_by(method: Method, cloud: PointCloud) -> PointCloud:
    """Return the cloud as the method gets it.

    Only the reference methods that draw the true mesh get it, and only methods whose images were
    drawn elsewhere get the origin of the cloud, by which their images are looked up.
    """
    source = cloud.source if method.sees_mesh else None
    origin = cloud.origin if method.images else None
    return PointCloud(cloud.points, source, origin, cloud.colors)


def _refuse_blank(images: UInt8Images, truth: UInt8Images | None, points: int) -> None:
    """Raise StageFailure where an image has one colour throughout and the true one has not."""

    def is_flat(images: UInt8Images) -> NDArray[np.bool_]:
        return (images == images[:, :1, :1]).all(axis=(1, 2, 3))

    # Such images come from a renderer that has lost its context, or that looks the wrong way.
    flat = is_flat(images) if truth is None else is_flat(images) & ~is_flat(truth)
    if flat.any():
        few = f"; {points} points are too few" if points < 32 else ""
        raise StageFailure("draw", f"{int(flat.sum())} of {len(flat)} images are blank{few}")


def cloud_of(job: Job) -> PointCloud:
    """Return the perturbed cloud, which depends on seed, object and condition only."""
    condition = job.condition
    stored = job.object.perturbed(condition) if isinstance(job.object, ExportedObject) else None
    if stored is not None:  # an export has the clouds of the conditions that it was made with
        return stored
    sampled = job.object.cloud(generator(job.seed, "cloud", *job.name.object))
    stream = stream_of(condition, job.perturbation)
    return job.perturbation.apply(sampled, generator(job.seed, stream, *job.name.object))


def cloud_under(job: Job, condition: str) -> PointCloud:
    """Return the cloud of a job's object under a condition, whether or not its method sees it."""
    change = find_condition(condition).perturbation
    return cloud_of(replace(job, condition=condition, perturbation=change))


def _origin(job: Job) -> CloudOrigin:
    """Return what the cloud of a job is: its condition, class, object and views."""
    views = job.object.exported_views if isinstance(job.object, ExportedObject) else job.views
    return CloudOrigin(job.condition, *job.name.object, views)


def rng_of(job: Job) -> np.random.Generator:
    """Return the source of random numbers for the method of a job."""
    return generator(job.seed, "method", job.method, job.condition, *job.name.object)


def checked_images(images: NDArray[np.float32], count: int, side: int = IMAGE_SIZE) -> UInt8Images:
    """Return the images that a method has drawn as uint8 [count, side, side, 3].

    Raises StageFailure for another type or shape, and for values that are not finite.
    """
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
    """Return the renderer of a method, which is loaded once in a process.

    Raises BadInput for weights that cannot be used.
    """
    return find_run_method(address).load(device)


@cache
def _extractor(name: str, weights: str, device: str) -> Extractor:
    return find_extractor(name).load(weights, device)


@dataclass(frozen=True, eq=False)
class _Step:
    """A task of a worker: a whole job, or drawing or scoring alone where code of others draws."""

    job: Job
    # The code of others that the step executes, "" for none: steps with the same share workers.
    foreign_code: str
    drawn: _RenderedViews | None = None  # images of an earlier step, which this one only scores

    def do(self) -> Result | _RenderedViews:
        """Do the step, and return the result of the job, or the images that are to be scored."""
        if self.drawn is not None:
            return _score_job(self.job, self.drawn)
        return _draw_job(self.job) if self.foreign_code else run_job(self.job)


class JobPool:
    """An executor (`bench.running.pool`) of jobs in worker processes of this machine.

    count    the number of jobs to come
    workers  how many processes work at a time, at most; not more than there are jobs

    A job whose process dies or takes too much memory has failed; one that takes too long is tried
    once more first. Code of others draws in workers of its own, and the images are scored in ours.
    """

    def __init__(
        self, count: int, workers: int, limits: Limits, tasks_per_worker: int = TASKS_PER_WORKER
    ) -> None:
        self._pool: TaskPool[_Step, Any] = TaskPool(
            _Step.do,
            min(workers, count),
            limits,
            tasks_per_worker=tasks_per_worker,
            group=attrgetter("foreign_code"),
        )
        self.capacity = self._pool.capacity
        self._late: set[str] = set()  # the keys of the jobs that have taken too long once

    def submit(self, job: Job) -> None:
        """Start a job; at most `capacity` may be under way."""
        self._pool.submit(_Step(job, _foreign_code(job)))

    def wait_any(self, timeout_s: float | None = None) -> Iterator[Result]:
        """Wait until jobs have ended, and yield the result of each; none after `timeout_s`."""
        for step, result in self._pool.wait_any(timeout_s):
            is_late = isinstance(result, WorkerFailure) and result.kind == "timeout"
            if isinstance(result, _RenderedViews):
                self._pool.submit(_Step(_without_foreign_code(step.job), "", result))
            elif is_late and step.job.key not in self._late:
                # The job may have been late only because the machine was busy.
                self._late.add(step.job.key)
                self._pool.submit(step)
            elif isinstance(result, WorkerFailure):
                yield failed(step.job, result.reason, result.taken_s)
            else:
                yield result

    def close(self) -> None:
        """Stop all workers at once."""
        self._pool.close()


def _without_foreign_code(job: Job) -> Job:
    """Return a job whose images are drawn, without what would load code of others in a worker.

    Its object has nothing left but its name, which is all that scoring needs.
    """
    obj = job.object
    name_alone: Any = SimpleNamespace(class_name=obj.class_name, object_id=obj.object_id)
    return replace(job, object=name_alone, perturbation=Unchanged())


def run_jobs(
    jobs: Sequence[Job],
    store: Store,
    title: str,
    start: Callable[[int], Executor],
) -> dict[str, Result]:
    """Do those jobs that the store has no results of, and return the results of all, by key.

    title  names the jobs in the line of progress
    start  returns an executor for a number of jobs
    """
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
    """Do jobs, and yield the result of each when the store has it.

    jobs    the jobs, in the order of their start, as the tasks of `submit_all`
    count   how many jobs there are, at most
    start   returns an executor for a number of jobs; it is closed here
    left_s  returns the seconds that are left, as in `submit_all`

    Results are yielded without images, features and scores, which are in the store. Raises
    MissingDependency where a library or a weights file is missing that all further jobs need, and
    BadInput where a ground truth has changed since it was drawn.
    """
    read_images = lru_cache(_REFERENCES_KEPT)(store.array)

    def with_truth(job: Job | None) -> Job | None:
        """Return a job together with the true images that its own are scored against."""
        if job is None or not job.reference_key:
            return job
        return replace(job, reference=read_images(job.reference_key))

    ready = map(with_truth, jobs)
    with closing(start(count)) as executor, closing(submit_all(ready, executor, left_s)) as stream:
        for result in stream:
            if result.unusable:
                raise MissingDependency(result.unusable)
            store.append(result)
            yield replace(result, views=b"", arrays={})
