"""The plan of a run: the list of all its jobs, with the key of each. Nothing is run."""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from collections.abc import Container, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from bench.catalogue.lookup import find
from bench.records.artifacts import artifact_path
from bench.records.job import Job
from bench.records.record import GROUND_TRUTH, SCHEMA_VERSION
from bench.running.protocol import Protocol, method_identity, name_of
from data_prep.clouds.conditions import CONDITIONS, Unchanged
from data_prep.datasets.exported import ExportedObject
from data_prep.datasets.grey import GreyObject
from data_prep.datasets.objects import MeshObject, SceneObject
from data_prep.datasets.registry import PROCEDURAL_VERSION
from data_prep.failures import BadInput
from data_prep.randomness import generator
from data_prep.scene import View

UNCHANGED = "2048"  # in the keys of jobs that are the same under every condition
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
    def jobs(self) -> tuple[Job, ...]:
        """Return each job once, the ground truth first."""
        unique: dict[str, Job] = {}
        for job in self.method_jobs:
            unique.setdefault(job.key, job)
        return (self.truth, *unique.values())


@dataclass(frozen=True)
class Plan:
    """All jobs of a run, in the order of its files."""

    objects: tuple[ObjectJobs, ...]

    @property
    def ground_truths(self) -> tuple[Job, ...]:
        """Return the jobs that draw the true images."""
        return tuple(obj.truth for obj in self.objects)

    @property
    def method_jobs(self) -> tuple[Job, ...]:
        """Return the jobs of the methods, one for each condition, object by object."""
        return tuple(job for obj in self.objects for job in obj.method_jobs)

    @property
    def jobs(self) -> tuple[Job, ...]:
        """Return each job once, object by object."""
        return tuple(job for obj in self.objects for job in obj.jobs)

    @property
    def in_turns(self) -> tuple[ObjectJobs, ...]:
        """Return the objects in the order of their start: the first of each class, the second..."""
        return tuple(obj for _, obj in sorted(self._numbered(), key=lambda pair: pair[0]))

    def select(self, objects: Container[str]) -> Plan:
        """Return the part of the objects with these names."""
        return Plan(tuple(obj for obj in self.objects if obj.name in objects))

    def _numbered(self) -> Iterator[tuple[int, ObjectJobs]]:
        """Yield each object with its number within its class, from 1."""
        numbers: Counter[str] = Counter()
        for obj in self.objects:
            numbers[obj.truth.object.class_name] += 1
            yield numbers[obj.truth.object.class_name], obj


def plan(protocol: Protocol, directory: Path) -> Plan:
    """Return all jobs of a run, object by object.

    Where the truth of the suite is grey, jobs have the objects in grey. Raises BadInput for unknown
    conditions and unusable weights, for bare clouds, which cannot be scored, for more views than
    objects have images, and for objects without a mesh where they are to be grey.
    """
    _refuse_bare_clouds(protocol)
    suite = protocol.suite
    conditions = [find(c, CONDITIONS, "condition") for c in protocol.conditions]
    methods = [(m, method_identity(m, protocol.device)) for m in protocol.methods.values()]
    objects = []
    for obj in _in_grey(protocol) if suite.truth == "grey" else protocol.objects:
        rng = generator(protocol.seed, "views", obj.class_name, obj.object_id)
        views = obj.views(protocol.views, rng)
        identity = _object_identity(protocol, obj, views)
        key = digest([suite.id, GROUND_TRUTH, "", identity])
        truth = Job(
            key=key,
            suite=suite.id,
            method=GROUND_TRUTH,
            condition="",
            perturbation=Unchanged(),
            object=obj,
            views=views,
            seed=protocol.seed,
            device=protocol.device,
            features=protocol.features,
            artifact=artifact_path(directory, key),
            reference=None,
        )
        method_jobs = []
        for condition in conditions:
            for method, version in methods:
                cloud = (
                    (condition.id, condition.perturbation)
                    if method.sees_cloud
                    else (UNCHANGED, Unchanged())
                )
                parts = [cloud[0], identity, version, repr(cloud[1]), SCORES_VERSION]
                key = digest([suite.id, method.id, *parts])
                job = replace(
                    truth,
                    key=key,
                    method=method.id,
                    condition=condition.id,
                    perturbation=condition.perturbation,
                    artifact=artifact_path(directory, key),
                    reference=truth.artifact,
                )
                method_jobs.append(job)
        objects.append(ObjectJobs(truth, tuple(method_jobs)))
    return Plan(tuple(objects))


def _refuse_bare_clouds(protocol: Protocol) -> None:
    bare = [obj for obj in protocol.objects if not obj.has_truth]
    if bare:
        raise BadInput(
            f"{protocol.dataset}: {name_of(bare[0])} is a bare cloud ({len(bare)} of "
            f"{len(protocol.objects)} are), without mesh or images to score against; draw it with "
            "'bench render'"
        )


def _in_grey(protocol: Protocol) -> Iterator[SceneObject]:
    suite = protocol.suite.id + " --truth grey" * protocol.suite.truth_chosen
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


def digest(identity: Sequence[Any]) -> str:
    """Return a key that names everything in `identity`."""
    return hashlib.sha256(json.dumps(identity).encode()).hexdigest()
