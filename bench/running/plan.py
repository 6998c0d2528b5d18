"""The plan of a run: all its jobs, with the key of each. Nothing is run."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, overload

from bench.catalogue.conditions import find_condition
from bench.catalogue.methods import Method
from bench.records.job import Job
from bench.records.record import GROUND_TRUTH, SCHEMA_VERSION
from bench.running.protocol import Protocol, method_identity, name_of
from data_prep.clouds.conditions import Condition, Perturbation, Unchanged
from data_prep.datasets.exported import UNPERTURBED, ExportedObject
from data_prep.datasets.grey import GreyObject
from data_prep.datasets.objects import MeshObject, SceneObject
from data_prep.datasets.registry import PROCEDURAL_VERSION
from data_prep.failures import BadInput
from data_prep.randomness import generator
from data_prep.scene import View

SCORES_VERSION = 2  # raise when a change alters a score


@dataclass(frozen=True)
class ObjectJobs:
    """The jobs of an object: the ground truth, which the others need, and those of the methods.

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
class Plan(Sequence[ObjectJobs]):
    """All jobs of a run, object by object in the order of its files.

    The jobs of an object are made when they are asked for, and nothing of them is kept: a run may
    have millions. A mesh is read for them, since its checksum is part of their keys.
    """

    protocol: Protocol
    scene_objects: tuple[SceneObject, ...]
    methods: tuple[tuple[Method, list[Any]], ...]
    conditions: tuple[Condition, ...]

    def __len__(self) -> int:
        return len(self.scene_objects)

    @overload
    def __getitem__(self, index: int) -> ObjectJobs: ...
    @overload
    def __getitem__(self, index: slice) -> Plan: ...
    def __getitem__(self, index: int | slice) -> ObjectJobs | Plan:
        if isinstance(index, slice):
            return replace(self, scene_objects=self.scene_objects[index])
        return self._jobs_of(self.scene_objects[index])

    @property
    def names(self) -> list[str]:
        """Return class and name of each object, as in the manifest."""
        return [name_of(obj) for obj in self.scene_objects]

    @property
    def jobs_per_object(self) -> int:
        """Return how many jobs each object has: one is done for all conditions of some methods."""
        seen = sum(len(self.conditions) if m.sees_cloud else 1 for m, _ in self.methods)
        return 1 + seen

    @property
    def job_count(self) -> int:
        """Return how many jobs all objects have."""
        return len(self) * self.jobs_per_object

    @property
    def method_jobs(self) -> Iterator[Job]:
        """Yield the jobs of the methods, one for each condition, object by object."""
        return (job for obj in self for job in obj.method_jobs)

    @property
    def jobs(self) -> Iterator[Job]:
        """Yield each job once, object by object."""
        return (job for obj in self for job in obj.jobs)

    def in_order(self, names: Iterable[str]) -> Plan:
        """Return the objects with these names, in their order."""
        chosen = tuple(self.scene_objects[self._places[name]] for name in names)
        return replace(self, scene_objects=chosen)

    def select(self, names: Iterable[str]) -> Plan:
        """Return the part of the objects with these names, in the order of the plan."""
        places = sorted(self._places[name] for name in names if name in self._places)
        return replace(self, scene_objects=tuple(self.scene_objects[i] for i in places))

    @cached_property
    def _places(self) -> dict[str, int]:
        return {name: place for place, name in enumerate(self.names)}

    @cached_property
    def _cells(self) -> list[tuple[Method, Condition, Perturbation, str, str]]:
        """Return method, condition and change of each job, and both ends of its identity.

        They are the same for all objects, and are encoded once: a run has a million jobs.
        """
        cells = []
        for condition in self.conditions:
            for method, version in self.methods:
                cloud, change, named = condition.id, condition.perturbation, condition.key
                if not method.sees_cloud:  # nothing that its key does not name may decide
                    cloud, change, named = UNPERTURBED, Unchanged(), repr(Unchanged())
                start = _encoded(self.protocol.suite.id, method.id, cloud)
                end = _encoded(version, named, SCORES_VERSION)
                cells.append((method, condition, change, start, end))
        return cells

    def _jobs_of(self, obj: SceneObject) -> ObjectJobs:
        protocol, suite = self.protocol, self.protocol.suite.id
        views = views_of(obj, protocol.views, protocol.seed)
        identity = _encoded(_object_identity(protocol, obj, views))

        def job(
            key: str,
            method: str,
            condition: str,
            change: Perturbation,
            truth: str | None,
            address: str = "",
        ) -> Job:
            return Job(
                key=key,
                suite=suite,
                method=method,
                address=address,
                condition=condition,
                perturbation=change,
                object=obj,
                views=views,
                seed=protocol.seed,
                device=protocol.device,
                features=protocol.features,
                reference_key=truth,
            )

        truth = _digest(_encoded(suite, GROUND_TRUTH, ""), identity)
        method_jobs = tuple(
            job(
                _digest(start, identity, end, *_stored_images(method, cell, obj, len(views))),
                method.id,
                cell.id,
                change,
                truth,
                method.address,
            )
            for method, cell, change, start, end in self._cells
        )
        return ObjectJobs(job(truth, GROUND_TRUTH, "", Unchanged(), None), method_jobs)


def views_of(obj: SceneObject, count: int, seed: int) -> tuple[View, ...]:
    """Return the views that a run with this seed has of an object."""
    return obj.views(count, generator(seed, "views", obj.class_name, obj.object_id))


def plan(protocol: Protocol) -> Plan:
    """Return all jobs of a run, object by object.

    Where the truth of the suite is grey, jobs have the objects in grey. Raises BadInput for unknown
    conditions and unusable weights, for bare clouds, which cannot be scored, for more views than
    objects have images, for objects without a mesh where they are to be grey, and for images of a
    method that are not of this run.
    """
    _refuse_bare_clouds(protocol)
    exported = [obj for obj in protocol.objects if isinstance(obj, ExportedObject)]
    for obj in exported:
        obj.views(protocol.views, generator(protocol.seed))
    for method in protocol.methods.values():
        if method.images:
            method.images.check(
                protocol.dataset, protocol.export, exported, protocol.conditions, protocol.views
            )
    return Plan(
        protocol,
        tuple(_in_grey(protocol)) if protocol.suite.truth == "grey" else protocol.objects,
        tuple((m, method_identity(m, protocol.device)) for m in protocol.methods.values()),
        tuple(find_condition(condition_id) for condition_id in protocol.conditions),
    )


def _refuse_bare_clouds(protocol: Protocol) -> None:
    bare = [obj for obj in protocol.objects if not obj.has_truth]
    if bare:
        raise BadInput(
            f"{protocol.dataset}: {name_of(bare[0])} is a bare cloud ({len(bare)} of "
            f"{len(protocol.objects)} are), without mesh or images to score against; draw it with "
            "'bench render'"
        )


def _in_grey(protocol: Protocol) -> Iterator[SceneObject]:
    suite = f"{protocol.suite.id} --truth grey"
    for obj in protocol.objects:
        if isinstance(obj, ExportedObject):  # its images are as they were exported
            if not obj.in_grey:
                raise BadInput(
                    f"{protocol.dataset}: {name_of(obj)} was exported in colour; export it again "
                    f"with --suite {suite}"
                )
            yield obj
            continue
        if not isinstance(obj, MeshObject):
            raise BadInput(
                f"{protocol.dataset}: {name_of(obj)} has images but no mesh, and "
                f"{suite} draws meshes in grey; take a dataset of meshes"
            )
        yield GreyObject(obj)


def _object_identity(protocol: Protocol, obj: SceneObject, views: Sequence[View]) -> list[Any]:
    """Return everything that the images of an object depend on, whatever draws them."""
    return [
        SCHEMA_VERSION,
        PROCEDURAL_VERSION,
        obj.class_name,
        obj.object_id,
        obj.fingerprint(),
        [[view.azimuth_deg, view.elevation_deg] for view in views],
        protocol.seed,
        sorted(protocol.feature_identity.items()),
        sorted(protocol.environment.items()),
    ]


def _stored_images(method: Method, condition: Condition, obj: SceneObject, views: int) -> list[str]:
    """Return the rest of the identity of a job: the images and times of a method that has some."""
    if method.images is None or not isinstance(obj, ExportedObject):
        return []
    claims = method.images.claims
    images = method.images.checksum(condition.id, obj, views)
    return [_encoded(images, claims.prepare_s, claims.draw_s)]


def digest(identity: Sequence[Any]) -> str:
    """Return a key that names everything in `identity`."""
    return _digest(_encoded(*identity))


def _encoded(*values: object) -> str:
    """Return values as elements of a list in JSON."""
    return json.dumps(values)[1:-1]


def _digest(*parts: str) -> str:
    """Return the key of a list in JSON, from parts of its elements."""
    return hashlib.sha256(f"[{', '.join(parts)}]".encode()).hexdigest()
