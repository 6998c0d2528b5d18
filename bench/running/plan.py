"""The plan of a run: its jobs, the key of each, and the order in which a budget lets them begin.

All jobs of an object come before those of the next object, so that a run that is stopped has
complete objects: each has the images of all methods under all conditions.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
import time
from collections import Counter, defaultdict, deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice, product, starmap, zip_longest
from typing import Any

from bench.catalogue.conditions import find_condition, needs_mesh
from bench.catalogue.methods import Method
from bench.records.job import GROUND_TRUTH, RECORDS_VERSION, Job, Result, failed
from bench.records.store import Store
from bench.running.protocol import Protocol, name_of
from data_prep.clouds.conditions import Condition, Unchanged
from data_prep.datasets.exported import UNPERTURBED, ExportedObject
from data_prep.datasets.objects import ColouredCloudObject, GreyObject, MeshObject, SceneObject
from data_prep.datasets.registry import PROCEDURAL_VERSION
from data_prep.failures import BadInput
from data_prep.randomness import generator
from data_prep.scene import View

# The version of all scores, in the key of every job: raise it when a change alters a score, and
# finished jobs are done again.
SCORES_VERSION = 2
_UNITS_S = {"s": 1, "m": 60, "h": 3600}  # the seconds of each unit of time that `--budget` takes
# Seconds that a run takes beside its jobs, by the default suite on two cores, and rather too much
# than too little.
START_S = 8.0  # to start the workers and to load the weights
END_S = 12.0  # to write tables, figures and report, whatever the number of objects
END_OF_OBJECT_S = 1.2  # for each object more in the tables, figures and report
_JOB_S = 0.6  # seconds that a worker takes for a job: the mean over the default suite


@dataclass(frozen=True)
class ObjectJobs:
    """The jobs of an object: its ground truth, and every method under every condition.

    A method that does not look at the cloud draws the same under every condition. Its jobs have one
    key, and only the first of them is done.
    """

    truth: Job
    method_jobs: tuple[Job, ...]

    @property
    def name(self) -> str:
        """Return class and name of the object, as the manifest has them."""
        return name_of(self.truth.object)

    @property
    def listed(self) -> tuple[Job, ...]:
        """Return the ground truth and a job for each method and condition.

        Jobs that are the same under every condition are repeated.
        """
        return (self.truth, *self.method_jobs)

    @property
    def jobs(self) -> tuple[Job, ...]:
        """Return each job that has to be done once, the ground truth first."""
        unique: dict[str, Job] = {}
        for job in self.method_jobs:
            unique.setdefault(job.key, job)
        return (self.truth, *unique.values())


@dataclass(frozen=True)
class Plan:
    """All jobs of a run, object by object in the order of its files.

    The jobs of an object are made anew each time they are asked for, because a run may have
    millions of them, more than memory holds. Making them reads the object's mesh, whose checksum is
    part of their keys.
    """

    protocol: Protocol
    # The objects as they are drawn (perhaps in grey) by class and name as the manifest has them.
    objects: Mapping[str, SceneObject]
    conditions: tuple[Condition, ...]

    def __len__(self) -> int:
        return len(self.objects)

    def __iter__(self) -> Iterator[ObjectJobs]:
        return map(self.jobs_of, self.objects)

    def __getitem__(self, place: int) -> ObjectJobs:
        return self.jobs_of(self.names[place])

    @property
    def names(self) -> list[str]:
        """Return class and name of each object, as the manifest has them."""
        return list(self.objects)

    @property
    def jobs_per_object(self) -> int:
        """Return how many jobs have to be done for each object, its ground truth included.

        A method has one job for each condition, or a single job where it does not look at the
        cloud.
        """
        ground_truth = 1
        count = ground_truth
        for method in self.protocol.methods.values():
            count += len(self.conditions) if method.sees_cloud else 1
        return count

    @property
    def method_jobs(self) -> Iterator[Job]:
        """Yield the jobs of the methods, one for each condition, object by object."""
        return (job for obj in self for job in obj.method_jobs)

    @property
    def jobs(self) -> Iterator[Job]:
        """Yield each job that has to be done once, object by object."""
        return (job for obj in self for job in obj.jobs)

    def jobs_of(self, name: str) -> ObjectJobs:
        """Return the jobs of the object with this class and name."""
        protocol, suite, obj = self.protocol, self.protocol.suite.id, self.objects[name]
        views = views_of(obj, protocol.views, protocol.seed)
        identity = _object_identity(protocol, obj, views)
        truth = Job(
            key=digest([suite, GROUND_TRUTH, "", identity]),
            suite=suite,
            method=GROUND_TRUTH,
            condition="",
            perturbation=Unchanged(),
            object=obj,
            views=views,
            seed=protocol.seed,
            device=protocol.device,
            features=protocol.features,
            reference_key=None,
        )

        def job(condition: Condition, method: Method) -> Job:
            cloud, change, change_key = condition.id, condition.perturbation, condition.key
            if not method.sees_cloud:
                # One job stands for all conditions, so neither its key nor its cloud names one.
                cloud, change, change_key = UNPERTURBED, Unchanged(), repr(Unchanged())
            method_key = protocol.identities[method.id]
            depends = [suite, method.id, cloud, identity, method_key, change_key, SCORES_VERSION]
            if method.images is not None:
                claims = method.images.claims
                checksum = method.images.checksum(condition.id, obj, len(views))
                depends += [checksum, claims.prepare_s, claims.draw_s]
            return replace(
                truth,
                key=digest(depends),
                method=method.id,
                address=method.address,
                condition=condition.id,
                perturbation=change,
                reference_key=truth.key,
            )

        pairs = product(self.conditions, protocol.methods.values())
        return ObjectJobs(truth, tuple(starmap(job, pairs)))


def views_of(obj: SceneObject, count: int, seed: int) -> tuple[View, ...]:
    """Return the `count` views of an object in every run with this seed."""
    return obj.views(count, generator(seed, "views", obj.class_name, obj.object_id))


def plan(protocol: Protocol) -> Plan:
    """Return the plan of all jobs of a run.

    Objects are drawn in grey, or their clouds get colours, where the suite's truth asks for it.
    Raises BadInput for unknown conditions, for weights that cannot be used, for objects without
    true images or without the mesh that a truth or a condition needs, and for images drawn by
    others that do not belong to this run.
    """
    if bare := [obj for obj in protocol.objects if not obj.has_truth]:
        raise BadInput(
            f"{protocol.dataset}: {name_of(bare[0])} is a bare cloud ({len(bare)} of "
            f"{len(protocol.objects)} are), without mesh or images to score against; draw it with "
            "'bench render'"
        )
    for obj in protocol.objects:
        if isinstance(obj, ExportedObject):  # refuses more views than it has
            obj.views(protocol.views, generator(protocol.seed))
    for method in protocol.methods.values():
        if method.images:
            method.images.check(
                protocol.dataset,
                protocol.export,
                protocol.objects,
                protocol.conditions,
                protocol.views,
            )
    protocol.identities  # noqa: B018 -- refuses unusable weights before anything is drawn
    _refuse_without_mesh(protocol)
    drawn = protocol.objects if protocol.suite.truth == "coloured" else _remade(protocol)
    return Plan(
        protocol,
        dict(zip(protocol.names, drawn, strict=True)),
        tuple(map(find_condition, protocol.conditions)),
    )


def _refuse_without_mesh(protocol: Protocol) -> None:
    """Raise BadInput where a condition samples a mesh anew and an object has none."""
    for condition in map(find_condition, protocol.conditions):
        for obj in protocol.objects if needs_mesh(condition.perturbation) else ():
            stored = isinstance(obj, ExportedObject) and obj.samples(condition.id)
            if not (stored or isinstance(obj, MeshObject)):
                raise BadInput(
                    f"{protocol.dataset}: {name_of(obj)} has no mesh, which the condition "
                    f"{condition.id} samples anew; leave it out of --conditions, or take a dataset "
                    "of meshes"
                )


def _remade(protocol: Protocol) -> Iterator[SceneObject]:
    """Yield the objects of a run in grey, or with colours of their points, as its truth asks.

    Raises BadInput where one cannot be had so.
    """
    suite = f"{protocol.suite.id} --truth {protocol.suite.truth}"
    for obj in protocol.objects:
        if protocol.suite.truth == "coloured-clouds":
            if not isinstance(obj, MeshObject):  # exports, too, keep points without colours
                raise BadInput(
                    f"{protocol.dataset}: {name_of(obj)} has a cloud without colours, and "
                    f"{suite} takes those of a mesh; take a dataset of meshes"
                )
            yield ColouredCloudObject(obj)
            continue
        what = f"{protocol.dataset}: {name_of(obj)}"
        if isinstance(obj, MeshObject) and not isinstance(obj, ExportedObject):
            yield GreyObject(obj)
        elif not isinstance(obj, ExportedObject):
            raise BadInput(
                f"{what} has images but no mesh, and {suite} draws meshes in grey; take a dataset "
                "of meshes"
            )
        elif not obj.in_grey:
            raise BadInput(f"{what} was exported in colour; export it again with --suite {suite}")
        else:
            yield obj  # its true images were exported in grey


def _object_identity(protocol: Protocol, obj: SceneObject, views: Sequence[View]) -> list[Any]:
    """Return everything that all images of an object depend on, whichever method draws them."""
    return [
        RECORDS_VERSION,
        PROCEDURAL_VERSION,
        obj.class_name,
        obj.object_id,
        obj.fingerprint(),
        [[view.azimuth_deg, view.elevation_deg] for view in views],
        protocol.seed,
        sorted(protocol.feature_identity.items()),
        sorted(protocol.environment.items()),
    ]


def digest(identity: Sequence[Any]) -> str:
    """Return a job's key: the SHA-256 checksum of everything that its result depends on."""
    return hashlib.sha256(json.dumps(identity).encode()).hexdigest()


def seconds_of(text: str, option: str = "--budget") -> float:
    """Return the seconds of a time like "90s", "2m" or "1.5h".

    Raises BadInput for any other text, which names the option.
    """
    match = re.fullmatch(r"([0-9]{1,9}(?:\.[0-9]{1,9})?)([smh])", text.strip())
    seconds = float(match[1]) * _UNITS_S[match[2]] if match else 0.0
    if not seconds:
        raise BadInput(f"{option} {text}: give a time over 0 with its unit, as in 90s, 2m or 1.5h")
    return seconds


def guess_s(jobs: int, workers: int) -> float:
    """Return the seconds that an object is expected to take, by its number of jobs."""
    return jobs * _JOB_S / workers


def end_s(objects: int) -> float:
    """Return the seconds that tables, figures and report are expected to take.

    objects  the number of objects in them
    """
    return END_S + END_OF_OBJECT_S * objects


def seeded_turns(names: Iterable[str], seed: int) -> list[str]:
    """Return the objects ("class/name") in the order of their start: in turn one of each class.

    The order within a class depends on the seed and on the names alone. So the objects of a run
    that is stopped early are a random sample, and the order of the others stays the same when
    objects are added or a run is started again. Classes keep their order.
    """
    by_class: dict[str, list[str]] = {}
    for name in names:
        by_class.setdefault(name.partition("/")[0], []).append(name)
    for members in by_class.values():
        members.sort(key=lambda name: generator(seed, "order of objects", name).random())
    turns = zip_longest(*by_class.values())
    return [name for turn in turns for name in turn if name is not None]


@dataclass
class Budget:
    """The time limit of a run, which counts from when the budget is made.

    It decides whether another object is begun, and when the jobs under way are stopped.
    """

    seconds: float | None = None  # for the whole run with its tables; None for no limit
    guess_s: float = 0.0  # the expected seconds of an object, used until one is complete
    clock: Callable[[], float] = time.monotonic
    _costs: list[float] = field(default_factory=list)  # the seconds that each object has taken
    _last: float | None = None  # when the last object was complete; at first when a job had ended

    def __post_init__(self) -> None:
        self._begun = self.clock()

    def check(self) -> None:
        """Raise BadInput where the time is too short for one object with its tables."""
        shortest = math.ceil(START_S + self.guess_s + end_s(1))
        if self.seconds is not None and self.seconds < shortest:
            raise BadInput(
                f"--budget {self.seconds:g}s: too short for one object with all methods and "
                f"conditions; give at least {shortest}s, or fewer of them"
            )

    def note(self, complete: bool) -> None:
        """Note that a job has ended; `complete` says whether its object is complete by it."""
        now = self.clock()
        if self._last is None:
            self._last = now
        if complete:
            self._costs.append(now - self._last)
            self._last = now

    def allows(self, complete: int, under_way: float) -> bool:
        """Return whether there is time for another object.

        complete   the number of complete objects
        under_way  the number of objects begun; each counts by the part of its jobs that is left
        """
        if self.seconds is None:
            return True
        cost = max(self._costs, default=self.guess_s)
        needed = (under_way + 1) * cost + end_s(complete + math.ceil(under_way) + 1)
        return self.clock() - self._begun + needed <= self.seconds

    def left_s(self, complete: int) -> float | None:
        """Return how many seconds jobs may still go on; None without a limit.

        Time is set aside for the tables of the `complete` objects, where there are any.
        """
        if self.seconds is None:
            return None
        end = end_s(complete) if complete else 0.0
        return self._begun + self.seconds - end - self.clock()


def settled(obj: ObjectJobs, store: Store) -> dict[str, Result]:
    """Return the results of those jobs of an object that need not be done any more, by key.

    Where the ground truth of the object has failed, no job need be done: there is nothing to score
    images against, and all jobs have failed.
    """
    results = store.find([job.key for job in obj.jobs])
    truth = results.get(obj.truth.key)
    if truth is not None and not truth.has_images:
        return {job.key: results.get(job.key) or failed(job, truth.reason) for job in obj.jobs}
    return results


@dataclass
class _UnderWay:
    """An object whose jobs are being done."""

    jobs: ObjectJobs
    open: dict[str, Job]  # the jobs that have not ended, by key
    has_truth: bool  # whether the ground truth has been drawn
    truth_sent: bool = False  # whether the job of the ground truth has been given out


class Schedule:
    """The jobs of a run in the order of their start, and how far the run has come.

    Only the objects under way and the names of the complete ones are in memory. An object whose
    ground truth has failed is complete: there is nothing to score, and all its jobs have failed.

    order  the names of the objects, in the order of their start
    ahead  for how many objects the ground truth is drawn before their other jobs begin: as many as
           idle workers could begin
    """

    def __init__(
        self, planned: Plan, store: Store, budget: Budget, order: Sequence[str], ahead: int = 1
    ) -> None:
        self.plan, self._store, self._budget = planned, store, budget
        self._order, self._ahead = order, ahead
        self._under_way: dict[str, _UnderWay] = {}
        self._object_of: dict[str, _UnderWay] = {}  # the object of each open job, by the job's key
        # For each object whose jobs have all ended, by name, whether its ground truth was drawn.
        self.complete: dict[str, bool] = {}
        self.failures = 0  # how many jobs have ended without images
        self.undrawn = ""  # the reason of the first ground truth that failed; "" where none has
        self.working: set[str] = set()  # the methods, or GROUND_TRUTH, that have given images
        # The seconds that workers have spent on each part of their jobs since this start.
        self.timing = defaultdict[str, float](float)
        # The number of finished jobs from before by the environment that they were made in, which
        # is a text as in the store.
        self.environments = Counter[str]()
        # All jobs of the run, and those that are left to be done; a budget may leave some undone.
        self.total = self.left = len(planned) * planned.jobs_per_object
        for obj in () if store.is_empty else map(planned.jobs_of, order):
            results = settled(obj, store)
            self.environments.update(r.environment for r in results.values() if r.environment)
            self._note(obj, results)
            if len(results) == len(obj.jobs):
                self.complete[obj.name] = results[obj.truth.key].has_images

    @property
    def scored(self) -> int:
        """Return how many complete objects have true images, which methods are scored against."""
        return sum(self.complete.values())

    def jobs(self) -> Iterator[Job | None]:
        """Yield the jobs to be done; None where the next job has to wait for a ground truth.

        The jobs end where the budget does not allow another object. The first object is always
        begun.
        """
        rest = (self.plan.jobs_of(name) for name in self._order if name not in self.complete)
        coming = deque(islice(rest, 1))
        begun: list[str] = []
        while coming:
            obj = coming.popleft()
            begun = [name for name in begun if name in self._under_way]
            states = [self._under_way[name] for name in begun]
            under_way = sum(len(state.open) / len(state.jobs.jobs) for state in states)
            allowed = self._budget.allows(len(self.complete), under_way)
            if (self.complete or begun) and not allowed:
                return
            begun.append(obj.name)
            coming.extend(islice(rest, self._ahead - len(coming)))
            # Ground truths are given out ahead of their objects, so that the jobs of an object need
            # not wait for its ground truth, except for the first object.
            states = [self._begin(some) for some in (obj, *coming)]
            for state in states:
                if not state.truth_sent and state.jobs.truth.key in state.open:
                    state.truth_sent = True
                    yield state.jobs.truth
            is_open = states[0].open
            while obj.truth.key in is_open:
                yield None
            yield from [job for job in obj.jobs if job.key in is_open]

    def left_s(self) -> float | None:
        """Return the seconds until jobs under way are to be stopped; None without a budget."""
        return self._budget.left_s(len(self.complete))

    def take(self, result: Result) -> bool:
        """Note the result of a job, and return whether its object is complete now.

        Where a ground truth has failed, all other jobs of its object have failed, too.
        """
        for part, seconds in result.timing.items():
            self.timing[part] += seconds
        state = self._object_of.pop(result.key)
        obj, ended = state.jobs, {result.key: result}
        if result.key == obj.truth.key:
            state.has_truth = result.has_images
            if not result.has_images:
                others = {key: job for key, job in state.open.items() if key != result.key}
                ended |= {key: failed(job, result.reason) for key, job in others.items()}
        self._note(obj, ended)
        for key in ended:
            del state.open[key]
            self._object_of.pop(key, None)
        if not state.open:
            del self._under_way[obj.name]
            self.complete[obj.name] = state.has_truth
        self._budget.note(not state.open)
        return not state.open

    def _begin(self, obj: ObjectJobs) -> _UnderWay:
        """Return an object as one that is under way, with its open jobs."""
        if obj.name not in self._under_way:
            done = self._store.find([job.key for job in obj.jobs])
            jobs = {job.key: job for job in obj.jobs if job.key not in done}
            # A finished ground truth has images: if it had failed, the object would be complete.
            state = _UnderWay(obj, jobs, has_truth=obj.truth.key in done)
            self._under_way[obj.name] = state
            self._object_of |= dict.fromkeys(jobs, state)
        return self._under_way[obj.name]

    def _note(self, obj: ObjectJobs, results: Mapping[str, Result]) -> None:
        """Count the results of an object's jobs by success and failure.

        The results of jobs that failed only because their ground truth did are stored here, since
        no worker has done these jobs.
        """
        for job in obj.jobs:
            if (result := results.get(job.key)) is None:
                continue
            self.left -= 1
            if result.has_images:
                self.working.add(job.method)
                continue
            self.failures += 1
            if job.method == GROUND_TRUTH:
                self.undrawn = self.undrawn or result.reason
            if result.views:
                self._store.append(result)
