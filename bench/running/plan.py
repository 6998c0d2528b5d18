"""The plan of a run: all its jobs, with the key of each. Nothing is run."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product, starmap
from typing import Any

from bench.catalogue.conditions import find_condition
from bench.catalogue.methods import Method
from bench.records.job import Job
from bench.records.record import GROUND_TRUTH, RECORDS_VERSION
from bench.running.protocol import Protocol, name_of
from data_prep.clouds.conditions import Condition, Unchanged
from data_prep.datasets.exported import UNPERTURBED, ExportedObject
from data_prep.datasets.objects import GreyObject, MeshObject, SceneObject
from data_prep.datasets.registry import PROCEDURAL_VERSION
from data_prep.failures import BadInput
from data_prep.randomness import generator
from data_prep.scene import View

SCORES_VERSION = 2  # raise when a change alters a score


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
