"""From the wishes of a command line to what is to be measured, by how many workers, and where."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from bench import manifest as manifests
from bench.lookup import find
from bench.methods import find_method
from bench.metric_table import WeightsUnavailable, find_extractor
from bench.plan import Protocol, with_floor
from bench.probe import environment
from bench.progress import say
from bench.shards import Shard
from bench.suites import Suite
from data_prep.conditions import CONDITIONS
from data_prep.datasets import Dataset, open_dataset
from data_prep.failures import BadInput
from data_prep.fingerprints import file_sha256
from data_prep.scene_objects import SceneObject

RUNS = Path("results/runs")


@dataclass(frozen=True)
class Options:
    """The wishes of the command line; None means the suite's choice."""

    suite: str
    dataset: str = "procedural"
    methods: tuple[str, ...] | None = None
    conditions: tuple[str, ...] | None = None
    limit: int | None = None
    views: int | None = None
    workers: int | None = None
    device: str = "auto"
    seed: int = 0
    out: Path | None = None
    fresh: bool = False
    shard: Shard | None = None
    ray: str | None = None
    inception_weights: str | None = None

    @property
    def directory(self) -> Path:
        """The run's folder."""
        return self.out or RUNS / default_name(self.suite, self.dataset, self.shard)


def refuse(suite: str, wishes: Iterable[tuple[str, object, str]]) -> None:
    """For a suite where some options have no meaning: (name, value, why) of each.

    Raises BadInput for the first that was given.
    """
    for name, value, why in wishes:
        if value is not None:
            raise BadInput(f"--{name}: has no meaning for the suite {suite}, {why}; leave it")


def workers_of(suite: Suite, options: Options) -> int:
    """Worker processes: as wished, else all cores; one where times are compared.

    Raises BadInput where that is not what was wished.
    """
    if suite.frontier:
        more = options.workers if options.workers != 1 else None
        refuse(suite.id, [("workers", more, "whose times are taken with nothing beside them")])
        return 1
    return options.workers or manifests.cores()


def default_name(suite: str, dataset: str, shard: Shard | None = None) -> str:
    """The folder of a run: suite, dataset and shard, as one file name."""
    kind, _, location = dataset.partition(":")
    parts = [suite, kind, Path(location).resolve().name] if location else [suite, kind]
    if shard is not None:
        parts.append(f"shard-{shard.number}-of-{shard.count}")
    return re.sub(r"[^A-Za-z0-9._-]+", "-", "-".join(parts))


def protocol_of(suite: Suite, options: Options) -> tuple[Protocol, dict[str, str]]:
    """What is to be measured, and the metrics that cannot be, with the reason.

    Raises BadInput for wishes that cannot be met, and MissingDependency where nothing can be drawn.
    """
    methods = with_floor(options.methods or suite.methods)
    for method in methods:
        find_method(method)
    conditions = tuple(dict.fromkeys(options.conditions or suite.conditions))
    for condition in conditions:
        find(condition, CONDITIONS, "condition")
    for name, value in (("limit", options.limit), ("views", options.views)):
        if value is not None and value < 1:
            raise BadInput(f"--{name} {value}: must be at least 1")
    dataset = open_dataset(options.dataset)
    objects = tuple(
        obj
        for class_name in _classes(suite, dataset)
        for obj in dataset.objects(class_name, options.limit, suite.endless_limit)
    )
    if options.shard is not None:
        objects = _dealt(options.shard, objects)
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
        seed=options.seed,
        device=options.device,
        features=tuple(features),
        feature_identity=identity,
        environment=environment(),
    )
    return protocol, skipped


def _dealt(shard: Shard, objects: tuple[SceneObject, ...]) -> tuple[SceneObject, ...]:
    if not (dealt := shard.of(objects)):
        raise BadInput(f"--shard {shard}: there are only {len(objects)} objects; make fewer shards")
    return dealt


def _classes(suite: Suite, dataset: Dataset) -> tuple[str, ...]:
    """The suite's classes that the dataset has; of several, those it lacks are told and left out.

    Raises BadInput where the suite compares classes and the dataset does not tell them apart.
    """
    if len(suite.classes) == 1:
        return suite.classes
    if not dataset.classes:
        raise BadInput(
            f"{dataset.id}: {suite.id} compares classes, and this dataset has none; give a folder "
            "whose sub-folders are classes"
        )
    there = tuple(name for name in suite.classes if name in dataset.classes)
    if there and len(there) < len(suite.classes):
        lacking = [name for name in suite.classes if name not in there]
        say(f"{dataset.id}: no {', '.join(lacking)}; left out")
    return there or suite.classes[:1]  # which the dataset refuses, with what it has
