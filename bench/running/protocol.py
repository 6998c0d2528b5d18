"""From the options of a command to what is measured, and to the list of jobs. Nothing is run.

A shard is a part of a run that is made apart, on machines that share nothing, by any scheduler:
shard k of N has every Nth object of the run, beginning with the kth, so that all shards have about
as much of every class. `bench.running.merge` puts them together.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections import Counter
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any, TypeVar
from unicodedata import category, normalize

from bench.catalogue.lookup import find
from bench.catalogue.methods import FLOOR, find_method, objectives
from bench.catalogue.metrics import WeightsUnavailable, find_extractor
from bench.catalogue.plugins import plugin_problem
from bench.catalogue.suites import Suite
from bench.records.artifacts import artifact_path
from bench.records.job import Job
from bench.records.journal import PROTOCOL
from bench.records.record import GROUND_TRUTH, SCHEMA_VERSION
from bench.running.environment import cores, environment, machine_info
from data_prep.clouds.conditions import CONDITIONS, Perturbation, Unchanged
from data_prep.datasets.exported import ExportedObject
from data_prep.datasets.grey import Unpainted
from data_prep.datasets.objects import MeshObject, SceneObject
from data_prep.datasets.protocol_version import PROTOCOL_VERSION
from data_prep.datasets.registry import PROCEDURAL_VERSION, Dataset, open_dataset
from data_prep.failures import BadInput
from data_prep.files.checksums import file_sha256
from data_prep.progress import log
from data_prep.randomness import generator
from data_prep.scene import View

Thing = TypeVar("Thing")
WHOLE: str | None = None  # stands in a manifest where a shard's name stands
LOCAL = "local"  # address of a Ray cluster that a run starts on this machine


@dataclass(frozen=True)
class Shard:
    """Number `number` (from 1) of `count`."""

    number: int
    count: int

    def __str__(self) -> str:
        return f"{self.number}/{self.count}"

    def of(self, things: Sequence[Thing]) -> tuple[Thing, ...]:
        """Those that are in this shard; none where there are fewer things than shards."""
        return tuple(things[self.number - 1 :: self.count])


def read_shard(text: str) -> Shard:
    """The shard with the name "k/N". Raises BadInput where that is none."""
    found = re.fullmatch(r"([0-9]{1,6})/([0-9]{1,6})", text)
    if found is not None:
        shard = Shard(int(found[1]), int(found[2]))
        if 1 <= shard.number <= shard.count:
            return shard
    raise BadInput(f"--shard {text}: give k/N, the kth of N parts, as in 1/4 ... 4/4")


def interleave(shards: Sequence[Sequence[Thing]]) -> list[Thing]:
    """The things of shards 1 to N in the order that they had before `Shard.of` chose among them.

    Raises ValueError where no things can have been shared out so: each shard has as many as the
    one before, or, once, one less.
    """
    total = sum(map(len, shards))
    places = [Shard(k, len(shards)).of(range(total)) for k in range(1, len(shards) + 1)]
    if [*map(len, shards)] != [*map(len, places)]:
        raise ValueError(f"{[*map(len, shards)]} things are not interleaved")
    back = dict(zip(chain(*places), chain(*shards), strict=True))
    return [back[place] for place in range(total)]


def objects_to_search(manifest: Mapping[str, Any]) -> int:
    """Return how many objects of a class hold all those of the run with this manifest."""
    name = manifest.get("shard")
    # Of a run that was stopped, the complete objects need not be the first that were planned.
    count = max(len(manifest["objects"]), manifest.get("planned", 0))
    return count * (read_shard(name).count if name else 1)


# More objects of a class than published datasets have (ShapeNet: 8,509 tables). Procedural classes
# have no end, and the plan of an object takes 3 ms and 70 kB.
MOST_OBJECTS = 10_000
# A job draws all views of an object at once; so many in float32 are half of what a worker may have.
MOST_VIEWS = 10_000
UNCHANGED = "2048"  # in the keys of what is the same under every condition
SCORES_VERSION = 2  # raise when a change alters a score


@dataclass(frozen=True)
class Protocol:
    """What a run measures. Two runs with equal protocols give equal tables on one machine.

    `environment` names what images depend on beside our own code (GL driver, library versions);
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


def name_of(obj: SceneObject) -> str:
    """Return class and name of an object, as manifests have them."""
    return f"{obj.class_name}/{obj.object_id}"


@dataclass(frozen=True)
class ObjectJobs:
    """The jobs of an object: the ground truth, which the others need, and the items.

    Items that are the same under every condition share a key: one job does them all.
    """

    truth: Job
    items: tuple[Job, ...]

    @property
    def name(self) -> str:
        """Class and name, as in the manifest."""
        return "/".join(self.truth.item.object)

    @property
    def jobs(self) -> tuple[Job, ...]:
        """Each job once."""
        once: dict[str, Job] = {}
        for job in self.items:
            once.setdefault(job.key, job)
        return (self.truth, *once.values())


@dataclass(frozen=True)
class Plan:
    """All jobs of a run, in the order of its files."""

    objects: tuple[ObjectJobs, ...]

    @property
    def references(self) -> tuple[Job, ...]:
        """The ground truths."""
        return tuple(obj.truth for obj in self.objects)

    @property
    def items(self) -> tuple[Job, ...]:
        """What the methods draw."""
        return tuple(job for obj in self.objects for job in obj.items)

    @property
    def jobs(self) -> tuple[Job, ...]:
        """Each job once, object by object."""
        return tuple(job for obj in self.objects for job in obj.jobs)

    @property
    def in_turns(self) -> tuple[ObjectJobs, ...]:
        """The objects in the order of their start: the first of each class, then the second."""
        return tuple(obj for _, obj in sorted(self._numbered(), key=lambda pair: pair[0]))

    def of(self, objects: Container[str]) -> Plan:
        """The part of some objects, by name."""
        return Plan(tuple(obj for obj in self.objects if obj.name in objects))

    def _numbered(self) -> Iterator[tuple[int, ObjectJobs]]:
        """Each object with its number within its class, from 1."""
        numbers: Counter[str] = Counter()
        for obj in self.objects:
            numbers[obj.truth.object.class_name] += 1
            yield numbers[obj.truth.object.class_name], obj


def plan(protocol: Protocol, directory: Path) -> Plan:
    """All jobs of a run, object by object.

    Where the suite is not `painted`, jobs have the objects in grey. Raises BadInput for unknown
    methods and conditions, for bare clouds, which cannot be scored, for more views than objects
    have images, and for objects without a mesh where they are to be grey.
    """
    _refuse_bare_clouds(protocol)
    conditions = [find(c, CONDITIONS, "condition") for c in protocol.conditions]
    identities = {m: method_identity(m, protocol.device) for m in protocol.methods}
    objects = []
    for obj in protocol.objects if protocol.suite.painted else _in_grey(protocol):
        rng = generator(protocol.seed, "views", obj.class_name, obj.object_id)
        views = obj.views(protocol.views, rng)
        common = _common_identity(protocol, obj, views)
        identity = ["", common]
        truth = _job(protocol, directory, obj, views, GROUND_TRUTH, "", Unchanged(), identity, None)
        items = []
        for condition in conditions:
            for method in protocol.methods:
                sees_cloud = find_method(method).sees_cloud
                seen = condition.perturbation if sees_cloud else Unchanged()
                named = condition.id if sees_cloud else UNCHANGED
                identity = [named, common, identities[method], repr(seen), SCORES_VERSION]
                items.append(
                    _job(
                        protocol,
                        directory,
                        obj,
                        views,
                        method,
                        condition.id,
                        condition.perturbation,
                        identity,
                        truth.artifact,
                    )
                )
        objects.append(ObjectJobs(truth, tuple(items)))
    return Plan(tuple(objects))


def _refuse_bare_clouds(protocol: Protocol) -> None:
    bare = [obj for obj in protocol.objects if not obj.has_truth]
    if bare:
        raise BadInput(
            f"{protocol.dataset}: {bare[0].class_name}/{bare[0].object_id} is a bare cloud "
            f"({len(bare)} of {len(protocol.objects)} are), without mesh or pictures to score "
            "against; draw it with 'bench render'"
        )


def _in_grey(protocol: Protocol) -> Iterator[SceneObject]:
    for obj in protocol.objects:
        if isinstance(obj, ExportedObject):  # its images are as they were exported
            if not obj.in_grey:
                raise BadInput(
                    f"{protocol.dataset}: {name_of(obj)} was exported in colour; export it again "
                    f"with --suite {protocol.suite.id}"
                )
            yield obj
            continue
        if not isinstance(obj, MeshObject):
            raise BadInput(
                f"{protocol.dataset}: {obj.class_name}/{obj.object_id} has pictures but no mesh, "
                f"and {protocol.suite.id} draws meshes in grey; take a dataset of meshes"
            )
        yield Unpainted(obj)


def with_floor(methods: Sequence[str]) -> tuple[str, ...]:
    """The methods and the floor: failures are scored as its images, so it is always measured."""
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
    key = digest([protocol.suite.id, method, *identity])
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


def describe(
    protocol: Protocol, workers: int, skipped_metrics: Mapping[str, str]
) -> dict[str, Any]:
    """The manifest of a run that is about to start."""
    return manifest_of(
        protocol,
        protocol.suite.id,
        protocol.views,
        protocol.environment,
        shard=str(protocol.shard) if protocol.shard else WHOLE,
        methods=list(protocol.methods),
        identities={m: method_identity(m, protocol.device) for m in protocol.methods},
        objectives=objectives(protocol.methods),
        conditions=list(protocol.conditions),
        objects=[name_of(obj) for obj in protocol.objects],
        skipped_metrics=dict(skipped_metrics),
        feature_identity=dict(protocol.feature_identity),
        workers=workers,
    )


def manifest_of(
    request: Protocol | Options,
    suite: str,
    views: int,
    environment: Mapping[str, str],
    **own: object,
) -> dict[str, Any]:
    """The manifest of a run of any suite that is about to start; `own` is what only this has."""
    asked = {"request": request.request} if isinstance(request, Options) else {}
    return {
        "schema_version": SCHEMA_VERSION,
        PROTOCOL: PROTOCOL_VERSION,
        **asked,
        "suite": suite,
        "dataset": request.dataset,
        "views": views,
        "seed": request.seed or 0,
        "device": request.device,
        **own,
        "environment": dict(environment),
    } | machine_info()


def method_identity(method_id: str, device: str) -> list[Any]:
    """What the images of a method depend on beside the cloud and the views."""
    method = find_method(method_id)
    return [method.version, method.identity(), device]


def digest(identity: Sequence[Any]) -> str:
    """A key that names everything in `identity`."""
    return hashlib.sha256(json.dumps(identity).encode()).hexdigest()


RUNS = Path("results/runs")
# Options that say what is measured, and not how or where.
REPEATED = (
    *("suite", "dataset", "methods", "conditions", "limit", "views", "device", "seed"),
    "inception_weights",
)


@dataclass(frozen=True)
class Options:
    """The options of the command line; None means the choice of the suite or of the dataset."""

    suite: str
    dataset: str = "procedural"
    methods: tuple[str, ...] | None = None
    conditions: tuple[str, ...] | None = None
    limit: int | None = None
    budget: float | None = None  # seconds
    views: int | None = None
    workers: int | None = None
    device: str = "auto"
    seed: int | None = None
    out: Path | None = None
    fresh: bool = False
    shard: Shard | None = None
    ray: str | None = None
    inception_weights: str | None = None

    @property
    def request(self) -> dict[str, Any]:
        """What is to be measured, as `bench run --config` reads it, without what is not said."""
        said = {name: getattr(self, name) for name in REPEATED}
        return {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in said.items()
            if value is not None
        }

    @property
    def directory(self) -> Path:
        """The run's folder."""
        return self.out or RUNS / default_name(self.suite, self.dataset, self.shard)


def refuse(suite: str, stated: Iterable[tuple[str, object, str]]) -> None:
    """For a suite where some options have no meaning: (name, value, why) of each.

    Raises BadInput for the first that was given.
    """
    for name, value, why in stated:
        if value is not None:
            option = name.replace("_", "-")
            raise BadInput(f"--{option}: has no meaning for the suite {suite}, {why}; leave it")


def refuse_counts(options: Options) -> None:
    """Raise BadInput for fewer than one object or view, and for more than a run can hold."""
    for name, value, most, remedy in (
        ("limit", options.limit, MOST_OBJECTS, ", or leave it for all objects of a folder"),
        ("views", options.views, MOST_VIEWS, ""),
    ):
        if value is not None and value < 1:
            raise BadInput(f"--{name} {value}: must be at least 1")
        if value is not None and value > most:
            raise BadInput(f"--{name} {value}: too many; give at most {most}{remedy}")


def refuse_absent_gpu(options: Options) -> None:
    """Raise BadInput for `--device cuda` where this machine, which is to draw, has no GPU."""
    if options.device == "cuda" and options.ray in (None, LOCAL):  # other nodes have GPUs of theirs
        from learning.training_loop import prepare_device

        prepare_device(options.device)


def seed_of(dataset: Dataset, options: Options) -> int:
    """Return the seed of a run. Raises BadInput for another than that of an exported dataset."""
    if dataset.seed is None:
        return options.seed or 0
    if options.seed not in (None, dataset.seed):
        raise BadInput(
            f"--seed {options.seed}: {dataset.id} was exported with --seed {dataset.seed}, which "
            "decides its clouds and views; leave --seed, or export it again with yours"
        )
    return dataset.seed


def workers_of(suite: Suite, options: Options) -> int:
    """Worker processes: as requested, else all cores; one where times are compared.

    Raises BadInput where that is not what was requested.
    """
    if suite.frontier:
        more = options.workers if options.workers != 1 else None
        refuse(suite.id, [("workers", more, "whose times are taken with nothing beside them")])
        return 1
    return options.workers or cores()


def default_name(suite: str, dataset: str, shard: Shard | None = None) -> str:
    """The folder of a run: suite, dataset and shard, as one file name."""
    kind, _, location = dataset.partition(":")
    parts = [suite, kind, Path(location).resolve().name] if location else [suite, kind]
    if shard is not None:
        parts.append(f"shard-{shard.number}-of-{shard.count}")
    return file_name(*parts)


def file_name(*parts: str) -> str:
    """Join the parts to one file name; a hyphen stands for what a name should not have."""
    kept = (char if _names_files(char) else "/" for char in normalize("NFC", "-".join(parts)))
    return re.sub("/+", "-", "".join(kept))


def _names_files(char: str) -> bool:
    """Return whether a file name keeps a character: letters, digits and marks of any script do."""
    return char.isalnum() or char in "._-" or category(char).startswith("M")


def protocol_of(suite: Suite, options: Options) -> tuple[Protocol, dict[str, str]]:
    """What is to be measured, and the metrics that cannot be, with the reason.

    Raises BadInput for options that cannot be met, and MissingDependency where nothing can be
    drawn.
    """
    methods = with_floor(options.methods or suite.methods)
    for method in methods:
        find_method(method)
        if problem := plugin_problem("method", method):  # ours is run
            log(problem)
    conditions = tuple(dict.fromkeys(options.conditions or suite.conditions))
    for condition in conditions:
        find(condition, CONDITIONS, "condition")
    refuse_counts(options)
    refuse_absent_gpu(options)
    dataset = open_dataset(options.dataset)
    seed = seed_of(dataset, options)
    objects = objects_of(suite, dataset, options)
    lacking = [name for name in suite.classes if name not in (dataset.classes or suite.classes)]
    if lacking and len(suite.classes) > 1:
        log(f"{dataset.id}: no {', '.join(lacking)}; left out")
    features: list[tuple[str, str]] = []
    identity: dict[str, str] = {}
    skipped: dict[str, str] = {}
    for metric in suite.extractors:
        try:
            extractor = find_extractor(metric)
            weights = extractor.weights(options.inception_weights)
        except WeightsUnavailable as error:
            skipped[metric] = f"skipped: weights; {error}"
            continue
        features.append((metric, str(weights)))
        identity[metric] = f"{extractor.version} {file_sha256(weights)}"
    protocol = Protocol(
        suite=suite,
        dataset=dataset.id,
        methods=methods,
        conditions=conditions,
        objects=objects,
        shard=options.shard,
        views=options.views or suite.views,
        seed=seed,
        device=options.device,
        features=tuple(features),
        feature_identity=identity,
        environment=environment(),
    )
    return protocol, skipped


def objects_of(suite: Suite, dataset: Dataset, options: Options) -> tuple[SceneObject, ...]:
    """Return the objects of a run, class by class; of a shard its own.

    Raises BadInput for a class that the dataset does not have, and for a shard without objects.
    """
    objects = tuple(
        obj
        for class_name in _classes(suite, dataset)
        for obj in dataset.objects(class_name, options.limit, suite.endless_limit)
    )
    if options.shard is None:
        return objects
    if not (dealt := options.shard.of(objects)):
        raise BadInput(
            f"--shard {options.shard}: there are only {len(objects)} objects; make fewer shards"
        )
    return dealt


def _classes(suite: Suite, dataset: Dataset) -> tuple[str, ...]:
    """Return the suite's classes that the dataset has.

    Raises BadInput where the suite compares classes and the dataset does not tell them apart.
    """
    if len(suite.classes) == 1:
        return suite.classes
    if not dataset.classes:
        raise BadInput(
            f"{dataset.id}: {suite.id} compares classes, and this dataset has none; give a folder "
            "whose sub-folders are classes"
        )
    shared = tuple(name for name in suite.classes if name in dataset.classes)
    return shared or suite.classes[:1]  # which the dataset refuses, with what it has
