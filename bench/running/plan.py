"""The plan of a run: all its jobs with the key of each, and their order, within a budget.

All methods and conditions of an object come before the next object, so that a run that is stopped
has complete objects.
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

from bench.catalogue.conditions import find_condition
from bench.catalogue.methods import Method
from bench.records.job import GROUND_TRUTH, RECORDS_VERSION, Job, Result, failed
from bench.records.store import Store
from bench.running.protocol import Protocol, name_of
from data_prep.clouds.conditions import Condition, Unchanged
from data_prep.datasets.exported import UNPERTURBED, ExportedObject
from data_prep.datasets.objects import GreyObject, MeshObject, SceneObject
from data_prep.datasets.registry import PROCEDURAL_VERSION
from data_prep.failures import BadInput
from data_prep.randomness import generator
from data_prep.scene import View

SCORES_VERSION = 2  # raise when a change alters a score
_UNITS_S = {"s": 1, "m": 60, "h": 3600}
# Seconds that a run takes beside its jobs: to start the workers and load the weights, and for
# tables, figures and report at its end, which grow with the objects. From the default suite on two
# cores, and rather too much than too little.
START_S, END_S, END_OF_OBJECT_S = 8.0, 12.0, 1.2
_JOB_S = 0.6  # of a worker for a job, in the mean of the default suite


@dataclass(frozen=True)
class ObjectJobs:
    """The jobs of an object: the ground truth, and those of the methods, one for each condition.

    Jobs that are the same under every condition share a key: the first stands for all of them.
    """

    truth: Job
    method_jobs: tuple[Job, ...]

    @property
    def name(self) -> str:
        """Return class and name, as in the manifest."""
        return name_of(self.truth.object)

    @property
    def listed(self) -> tuple[Job, ...]:
        """Return the ground truth and the jobs of all cells, of which some may be one job."""
        return (self.truth, *self.method_jobs)

    @property
    def jobs(self) -> tuple[Job, ...]:
        """Return each job once, the ground truth first."""
        unique: dict[str, Job] = {}
        for job in self.method_jobs:
            unique.setdefault(job.key, job)
        return (self.truth, *unique.values())


@dataclass(frozen=True)
class Plan:
    """All jobs of a run, object by object in the order of its files.

    The jobs of an object are made when they are asked for, and nothing of them is kept: a run may
    have millions. A mesh is read for them, since its checksum is part of their keys.
    """

    protocol: Protocol
    objects: Mapping[str, SceneObject]  # as they are drawn, by class and name as in the manifest
    conditions: tuple[Condition, ...]

    def __len__(self) -> int:
        return len(self.objects)

    def __iter__(self) -> Iterator[ObjectJobs]:
        return map(self.jobs_of, self.objects)

    def __getitem__(self, place: int) -> ObjectJobs:
        return self.jobs_of(self.names[place])

    @property
    def names(self) -> list[str]:
        """Return class and name of each object, as in the manifest."""
        return list(self.objects)

    @property
    def jobs_per_object(self) -> int:
        """Return how many jobs each object has: one is done for all conditions of some methods."""
        methods = self.protocol.methods.values()
        return 1 + sum(len(self.conditions) if method.sees_cloud else 1 for method in methods)

    @property
    def method_jobs(self) -> Iterator[Job]:
        """Yield the jobs of the methods, one for each condition, object by object."""
        return (job for obj in self for job in obj.method_jobs)

    @property
    def jobs(self) -> Iterator[Job]:
        """Yield each job once, object by object."""
        return (job for obj in self for job in obj.jobs)

    def jobs_of(self, name: str) -> ObjectJobs:
        """Return the jobs of an object."""
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
            cloud, change, named = condition.id, condition.perturbation, condition.key
            if not method.sees_cloud:  # nothing that its key does not name may decide
                cloud, change, named = UNPERTURBED, Unchanged(), repr(Unchanged())
            version = protocol.identities[method.id]
            depends = [suite, method.id, cloud, identity, version, named, SCORES_VERSION]
            if method.images is not None and isinstance(obj, ExportedObject):
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

        cells = product(self.conditions, protocol.methods.values())
        return ObjectJobs(truth, tuple(starmap(job, cells)))


def views_of(obj: SceneObject, count: int, seed: int) -> tuple[View, ...]:
    """Return the views that a run with this seed has of an object."""
    return obj.views(count, generator(seed, "views", obj.class_name, obj.object_id))


def plan(protocol: Protocol) -> Plan:
    """Return all jobs of a run, object by object; in grey where the truth of the suite is grey.

    Raises BadInput for unknown conditions, for unusable weights, for objects that cannot be scored,
    or not in grey, and for images of a method that are not of this run.
    """
    if bare := [obj for obj in protocol.objects if not obj.has_truth]:
        raise BadInput(
            f"{protocol.dataset}: {name_of(bare[0])} is a bare cloud ({len(bare)} of "
            f"{len(protocol.objects)} are), without mesh or images to score against; draw it with "
            "'bench render'"
        )
    exported = [obj for obj in protocol.objects if isinstance(obj, ExportedObject)]
    for obj in exported:
        obj.views(protocol.views, generator(protocol.seed))
    for method in protocol.methods.values():
        if method.images:
            method.images.check(
                protocol.dataset, protocol.export, exported, protocol.conditions, protocol.views
            )
    protocol.identities  # noqa: B018 -- refuses unusable weights before anything is drawn
    drawn = _in_grey(protocol) if protocol.suite.truth == "grey" else protocol.objects
    return Plan(
        protocol,
        dict(zip(protocol.names, drawn, strict=True)),
        tuple(map(find_condition, protocol.conditions)),
    )


def _in_grey(protocol: Protocol) -> Iterator[SceneObject]:
    suite = f"{protocol.suite.id} --truth grey"
    for obj in protocol.objects:
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
            yield obj  # its images are as they were exported


def _object_identity(protocol: Protocol, obj: SceneObject, views: Sequence[View]) -> list[Any]:
    """Return everything that the images of an object depend on, whatever draws them."""
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
    """Return a key that names everything in `identity`."""
    return hashlib.sha256(json.dumps(identity).encode()).hexdigest()


def seconds_of(text: str, option: str = "--budget") -> float:
    """Return the seconds of a time like "90s", "2m" or "1.5h". Raises BadInput for other texts."""
    match = re.fullmatch(r"([0-9]{1,9}(?:\.[0-9]{1,9})?)([smh])", text.strip())
    seconds = float(match[1]) * _UNITS_S[match[2]] if match else 0.0
    if not seconds:
        raise BadInput(f"{option} {text}: give a time over 0 with its unit, as in 90s, 2m or 1.5h")
    return seconds


def guess_s(jobs: int, workers: int) -> float:
    """Return the seconds that an object of so many jobs is expected to take."""
    return jobs * _JOB_S / workers


def end_s(objects: int) -> float:
    """Return the seconds for the tables, figures and report of so many objects."""
    return END_S + END_OF_OBJECT_S * objects


def seeded_turns(names: Iterable[str], seed: int) -> list[str]:
    """Return objects "class/name" in turns: one of each class, another of each...

    Within a class they come in an order that depends on the seed and on their names alone, so that
    it says nothing about results, and neither more objects nor an earlier start change the order of
    the others. Classes keep their order.
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
    """A time limit of a run, from now: whether to begin another object, when to end those begun."""

    seconds: float | None = None  # of the whole run, tables included; None for no limit
    guess_s: float = 0.0  # for an object, as long as none has been done
    clock: Callable[[], float] = time.monotonic
    _costs: list[float] = field(default_factory=list)
    _last: float | None = None  # when an object was complete, at first when a job was

    def __post_init__(self) -> None:
        self._begun = self.clock()

    def check(self) -> None:
        """Raise BadInput where not even one object would fit."""
        shortest = math.ceil(START_S + self.guess_s + end_s(1))
        if self.seconds is not None and self.seconds < shortest:
            raise BadInput(
                f"--budget {self.seconds:g}s: too short for one object with all methods and "
                f"conditions; give at least {shortest}s, or fewer of them"
            )

    def note(self, complete: bool) -> None:
        """Note that a job has ended, and with it an object if `complete`."""
        now = self.clock()
        if self._last is None:
            self._last = now
        if complete:
            self._costs.append(now - self._last)
            self._last = now

    def allows(self, complete: int, under_way: float) -> bool:
        """Return whether to begin another object, with so many complete and so many under way."""
        if self.seconds is None:
            return True
        cost = max(self._costs, default=self.guess_s)
        needed = (under_way + 1) * cost + end_s(complete + math.ceil(under_way) + 1)
        return self.clock() - self._begun + needed <= self.seconds

    def left_s(self, complete: int) -> float | None:
        """Return how long jobs may go on, with so many objects complete; None without a limit."""
        if self.seconds is None:
            return None
        end = end_s(complete) if complete else 0.0  # else there are no tables
        return self._begun + self.seconds - end - self.clock()


def settled(obj: ObjectJobs, store: Store) -> dict[str, Result]:
    """Return the results of an object's jobs that need not be done any more, by key.

    Where its ground truth has failed, that is all of them.
    """
    results = store.find([job.key for job in obj.jobs])
    truth = results.get(obj.truth.key)
    if truth is not None and not truth.has_images:
        return {job.key: results.get(job.key) or failed(job, truth.reason) for job in obj.jobs}
    return results


@dataclass
class _UnderWay:
    """An object whose jobs are being done, and those that have not ended, by key."""

    jobs: ObjectJobs
    open: dict[str, Job]
    has_truth: bool
    truth_sent: bool = False


class Schedule:
    """The jobs of a run in the order of their start, and how far the run has come.

    In memory are the objects under way and the names of those that are complete. An object whose
    ground truth has failed is complete: there is nothing to score, and all its jobs have failed.
    """

    def __init__(
        self, planned: Plan, store: Store, budget: Budget, order: Sequence[str], ahead: int = 1
    ) -> None:
        # `order` has the names of the objects in the order of their start. So many objects have
        # their ground truths drawn `ahead` of their jobs: those that idle workers could begin.
        self.plan, self._store, self._budget = planned, store, budget
        self._order, self._ahead = order, ahead
        self._under_way: dict[str, _UnderWay] = {}
        self._object_of: dict[str, _UnderWay] = {}  # by the keys of the open jobs
        # The objects whose jobs have all ended, by name: whether they have a ground truth.
        self.complete: dict[str, bool] = {}
        self.failures = 0  # jobs that have ended without images
        self.undrawn = ""  # why the first ground truth that failed could not be drawn
        self.working: set[str] = set()  # the methods with an image, and GROUND_TRUTH
        self.timing = defaultdict[str, float](float)  # seconds of the jobs of this start
        self.environments = Counter[str]()  # that jobs from before were made in, as in the store
        # Jobs of the run, and jobs to be done, if there were no budget.
        self.total = self.left = len(planned) * planned.jobs_per_object
        for obj in () if store.is_empty else map(planned.jobs_of, order):
            results = settled(obj, store)
            self.environments.update(r.environment for r in results.values() if r.environment)
            self._note(obj, results)
            if len(results) == len(obj.jobs):
                self.complete[obj.name] = results[obj.truth.key].has_images

    @property
    def scored(self) -> int:
        """Return how many complete objects have a ground truth."""
        return sum(self.complete.values())

    def jobs(self) -> Iterator[Job | None]:
        """Yield the jobs to be done; None where the next job waits for a ground truth.

        They end where the budget does not allow another object. The first object is always begun.
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
            # Ground truths are drawn ahead: nothing waits for one but at the start.
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
        """Return the seconds until what is under way is to be stopped; None without a budget."""
        return self._budget.left_s(len(self.complete))

    def take(self, result: Result) -> bool:
        """Note the result of a job, and return whether its object is complete by it."""
        for part, seconds in result.timing.items():
            self.timing[part] += seconds
        state = self._object_of.pop(result.key)
        obj, ended = state.jobs, {result.key: result}
        if result.key == obj.truth.key:
            state.has_truth = result.has_images
            if not result.has_images:
                ended |= {k: failed(job, result.reason) for k, job in state.open.items()} | ended
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
        if obj.name not in self._under_way:
            done = self._store.find([job.key for job in obj.jobs])
            jobs = {job.key: job for job in obj.jobs if job.key not in done}
            # A ground truth that has failed would have completed the object.
            state = _UnderWay(obj, jobs, obj.truth.key in done)
            self._under_way[obj.name] = state
            self._object_of |= dict.fromkeys(jobs, state)
        return self._under_way[obj.name]

    def _note(self, obj: ObjectJobs, results: Mapping[str, Result]) -> None:
        """Count results, and store those of jobs that have failed for want of a ground truth."""
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
