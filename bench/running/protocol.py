"""From a suite and the wishes of the command line to the list of jobs. Pure: nothing is run."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bench.catalogue.lookup import find
from bench.catalogue.methods import FLOOR, find_method
from bench.catalogue.suites import Suite
from bench.records.artifacts import artifact_path
from bench.records.record import GROUND_TRUTH, SCHEMA_VERSION
from bench.running.shards import Shard
from bench.running.work import Job
from data_prep.conditions import CONDITIONS, Perturbation, Unchanged
from data_prep.datasets import PROCEDURAL_VERSION, SceneObject
from data_prep.failures import BadInput
from data_prep.randomness import generator
from data_prep.scene import View

SCORES_VERSION = 1  # raise when a change alters a score


@dataclass(frozen=True)
class Protocol:
    """What a run measures. Two runs with equal protocols give equal tables on one machine.

    `environment` names what pictures depend on beside our own code (GL driver, library versions);
    `features` are the (id, weights file) of the set metrics that can be taken, `feature_identity`
    the checksum or version behind each; `shard` is the part of a run that `objects` are.
    """

    suite: Suite
    dataset: str
    methods: tuple[str, ...]
    conditions: tuple[str, ...]
    objects: tuple[SceneObject, ...]
    views: int
    seed: int
    device: str
    features: tuple[tuple[str, str], ...]
    feature_identity: Mapping[str, str]
    environment: Mapping[str, str]
    shard: Shard | None = None


@dataclass(frozen=True)
class Plan:
    """The ground truths, which everything else needs, and the items of the benchmark."""

    references: tuple[Job, ...]
    items: tuple[Job, ...]


def plan(protocol: Protocol, directory: Path) -> Plan:
    """All jobs of a run, in the order in which they are started: object by object.

    Raises BadInput for unknown methods and conditions, for bare clouds, which cannot be scored, and
    for more views than objects have pictures.
    """
    _refuse_bare_clouds(protocol)
    conditions = [find(c, CONDITIONS, "condition") for c in protocol.conditions]
    identities = {m: method_identity(m, protocol.device) for m in protocol.methods}
    references, items = [], []
    for obj in protocol.objects:
        rng = generator(protocol.seed, "views", obj.class_name, obj.object_id)
        views = obj.views(protocol.views, rng)
        common = _common_identity(protocol, obj, views)
        truth = _job(protocol, directory, obj, views, GROUND_TRUTH, "", Unchanged(), [common], None)
        references.append(truth)
        items += [
            _job(
                protocol,
                directory,
                obj,
                views,
                method,
                condition.id,
                condition.perturbation,
                [common, identities[method], repr(condition.perturbation), SCORES_VERSION],
                truth.artifact,
            )
            for condition in conditions
            for method in protocol.methods
        ]
    return Plan(tuple(references), tuple(items))


def _refuse_bare_clouds(protocol: Protocol) -> None:
    bare = [obj for obj in protocol.objects if not obj.has_truth]
    if bare:
        raise BadInput(
            f"{protocol.dataset}: {bare[0].class_name}/{bare[0].object_id} is a bare cloud "
            f"({len(bare)} of {len(protocol.objects)} are), without mesh or pictures to score "
            "against; draw it with 'bench render'"
        )


def with_floor(methods: Sequence[str]) -> tuple[str, ...]:
    """The methods and the floor: failures are scored as its pictures, so it is always measured."""
    unique = tuple(dict.fromkeys(methods))
    return unique if FLOOR in unique else (*unique, FLOOR)


def _job(
    protocol: Protocol,
    directory: Path,
    obj: SceneObject,
    views: tuple[View, ...],
    method: str,
    condition: str,
    perturbation: Perturbation,
    identity: Sequence[Any],
    reference: Path | None,
) -> Job:
    key = digest([protocol.suite.id, method, condition, *identity])
    return Job(
        key=key,
        suite=protocol.suite.id,
        method=method,
        condition=condition,
        perturbation=perturbation,
        object=obj,
        views=views,
        seed=protocol.seed,
        device=protocol.device,
        features=protocol.features,
        artifact=artifact_path(directory, key),
        reference=reference,
    )


def _common_identity(protocol: Protocol, obj: SceneObject, views: Sequence[View]) -> list[Any]:
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


def method_identity(method_id: str, device: str) -> list[Any]:
    """What the pictures of a method depend on beside the cloud and the views."""
    method = find_method(method_id)
    return [method.version, method.identity(), device]


def digest(identity: Sequence[Any]) -> str:
    """A key that names everything in `identity`."""
    return hashlib.sha256(json.dumps(identity).encode()).hexdigest()
