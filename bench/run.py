"""A run from beginning to end: plan, ground truth, items, records, tables, figures."""

from __future__ import annotations

import re
import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

from bench import manifest as manifests
from bench.artifacts import Item
from bench.finish import Outputs, timed, write_outputs
from bench.isolation import Limits
from bench.lookup import find
from bench.methods import find_method
from bench.metric_table import WeightsUnavailable, find_extractor
from bench.plan import Plan, Protocol, plan, with_floor
from bench.pool import run_jobs
from bench.probe import environment
from bench.progress import progress
from bench.report import Made, write_report
from bench.shards import Shard
from bench.spent import shares
from bench.store import Journal, check_directory, open_journal, set_aside, write_manifest
from bench.suites import SUITES, Suite
from bench.work import Job, Result, failed
from data_prep.conditions import CONDITIONS
from data_prep.datasets import Dataset, open_dataset
from data_prep.failures import BadInput, MissingDependency
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
    inception_weights: str | None = None


@dataclass(frozen=True)
class Finished:
    """A complete run: where it is, its tables, and how many items were done now and before.

    shares  of the workers' time, see `bench.spent.shares`
    """

    directory: Path
    outputs: Outputs
    done: int
    reused: int
    failed: int
    seconds: dict[str, float]
    shares: dict[str, float]


def run(options: Options) -> Finished:
    """Carry out a run, or what is left of it.

    Raises BadInput for anything the user has to mend; what was done until then is kept.
    """
    start = time.perf_counter()
    suite = find(options.suite, SUITES, "suite")
    directory = options.out or RUNS / default_name(suite.id, options.dataset, options.shard)
    protocol, skipped = _protocol(suite, options)
    workers = _workers(suite, options)
    todo = plan(protocol, directory)  # refuses weights that cannot be used
    manifest = manifests.describe(protocol, workers, skipped)
    if options.fresh and (old := set_aside(directory)):
        _say(f"the old run is now {old}")
    check_directory(directory, manifest)
    seconds: dict[str, float] = {}
    with open_journal(directory) as journal:
        write_manifest(directory, manifest)
        with timed("ground truth", seconds):
            truths = do_jobs(todo.references, journal, workers, suite.limits, "ground truth")
            _check_any_truth(todo, truths)
        with timed("items", seconds):
            drawable, hopeless = _split(todo, truths)
            results = do_jobs(drawable, journal, workers, suite.limits, suite.id) | hopeless
        outputs = write_outputs(
            directory,
            suite.id,
            _in_order(todo, truths | results),
            [metric for metric, _ in protocol.features],
            seconds,
        )
        for line in journal.damage:
            _say(line)
        spent = (result.spent for result in (*truths.values(), *results.values()))
        of_workers = shares(spent, workers * (time.perf_counter() - start))
        manifest |= {
            "finished": manifests.now(),
            "stage_seconds": seconds,
            "worker_shares": {part: round(share, 4) for part, share in of_workers.items()},
        }
        write_manifest(directory, manifest)
    write_report(directory, made=Made(outputs.tables, outputs.orderings, outputs.beyond))
    done = _count_new(todo, hopeless, journal)
    return Finished(
        directory,
        outputs,
        done=done,
        reused=len(todo.items) - done,
        failed=sum(results[job.key].artifact_sha256 is None for job in todo.items),
        seconds=seconds,
        shares=of_workers,
    )


def refuse(suite: str, wishes: Iterable[tuple[str, object, str]]) -> None:
    """For a suite where some options have no meaning: (name, value, why) of each.

    Raises BadInput for the first that was given.
    """
    for name, value, why in wishes:
        if value is not None:
            raise BadInput(f"--{name}: has no meaning for the suite {suite}, {why}; leave it")


def _workers(suite: Suite, options: Options) -> int:
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


def _protocol(suite: Suite, options: Options) -> tuple[Protocol, dict[str, str]]:
    """What is to be measured, and the metrics that cannot be, with the reason."""
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
        identity[metric] = f"{extractor.version} {sha256(weights.read_bytes()).hexdigest()}"
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
        _say(f"{dataset.id}: no {', '.join(lacking)}; left out")
    return there or suite.classes[:1]  # which the dataset refuses, with what it has


def do_jobs(
    jobs: Sequence[Job], journal: Journal, workers: int, limits: Limits, title: str
) -> dict[str, Result]:
    """The results of all jobs by key: those in the journal, and the rest by running them.

    Raises MissingDependency where going on makes no sense.
    """
    results = {job.key: found for job in jobs if (found := journal.usable(job))}
    missing = [job for job in jobs if job.key not in results]
    if not missing:
        return results
    if results:
        _say(f"{title}: {len(results)} of {len(jobs)} are there from before")
    failures = 0
    workers = min(workers, len(missing))
    with (
        progress(title, len(missing)) as advance,
        closing(run_jobs(missing, workers, limits)) as stream,
    ):
        for result in stream:
            if result.unusable:
                raise MissingDependency(result.unusable)
            journal.append(result)
            results[result.key] = result
            failures += result.artifact_sha256 is None
            advance(failures)
    return results


def _check_any_truth(todo: Plan, truths: Mapping[str, Result]) -> None:
    """One bad object among many is a failed record; if none can be drawn, the input is wrong."""
    if any(truth.artifact_sha256 for truth in truths.values()):
        return
    first = truths[todo.references[0].key].records[0].reason.removeprefix("input: ")
    raise BadInput(f"none of the {len(truths)} objects can be drawn; the first: {first}")


def _split(todo: Plan, truths: Mapping[str, Result]) -> tuple[list[Job], dict[str, Result]]:
    """Items whose ground truth is there, and the results of the others: failed, same reason."""
    reasons = {
        job.artifact: truths[job.key].records[0].reason
        for job in todo.references
        if truths[job.key].artifact_sha256 is None
    }
    drawable = [job for job in todo.items if job.reference not in reasons]
    hopeless = {
        job.key: failed(job, reasons[job.reference])
        for job in todo.items
        if job.reference is not None and job.reference in reasons
    }
    return drawable, hopeless


def _count_new(todo: Plan, hopeless: Mapping[str, Result], journal: Journal) -> int:
    """Items that this start has settled; one without a ground truth was settled with that."""
    truths: dict[Path | None, str] = {job.artifact: job.key for job in todo.references}
    settled_by = (truths[j.reference] if j.key in hopeless else j.key for j in todo.items)
    return sum(key in journal.added for key in settled_by)


def _in_order(todo: Plan, results: Mapping[str, Result]) -> list[tuple[Item, Result]]:
    return [(job.item, results[job.key]) for job in (*todo.references, *todo.items)]


def _say(line: str) -> None:
    print(line, file=sys.stderr, flush=True)
