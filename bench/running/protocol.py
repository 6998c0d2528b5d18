"""The protocol of a run: what is measured, from options or a manifest, and as a manifest."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from bench.catalogue.conditions import condition_ids, find_condition
from bench.catalogue.images import address_of, manifest_entry
from bench.catalogue.loaders import GPU
from bench.catalogue.methods import FLOOR, RECOMMENDED, Method, find_run_method, objectives
from bench.catalogue.metrics import FID, WeightsUnavailable, find_extractor, metrics_device
from bench.catalogue.plugins import plugin_problem
from bench.catalogue.suites import (
    TRUTHS,
    Suite,
    left_out_in_grey,
    stored_suite,
    truth_entry,
    with_truth,
)
from bench.records.record import SCHEMA_VERSION
from bench.records.run_folder import CONDITION_IDENTITIES
from bench.records.run_folder import PROTOCOL as PROTOCOL_ENTRY
from bench.running.environment import environment, machine_info
from bench.running.options import (
    Options,
    Shard,
    device_of,
    read_shard,
    refuse_absent_gpu,
    refuse_counts,
    seed_of,
)
from data_prep.datasets.objects import SceneObject
from data_prep.datasets.protocol_version import PROTOCOL_VERSION
from data_prep.datasets.registry import Dataset, open_dataset
from data_prep.failures import BadInput
from data_prep.files.checksums import file_sha256
from data_prep.progress import log

WHOLE: str | None = None  # in the manifest of a run that is no shard


@dataclass(frozen=True)
class Protocol:
    """The measurements of a run. Equal protocols give equal tables on one machine.

    Attributes
    ----------
    suite : Suite
    dataset : str
    methods : mapping
        The methods by id, in the order of the tables.
    conditions : tuple of str
    objects : tuple of SceneObject
        The objects of the run; where there is a `shard`, those of the shard.
    views : int
        Images of each object.
    seed : int
    device : str
        Where networks run: "cpu", "cuda", or "auto" where `device_of` leaves it.
    features : tuple of (str, str)
        Id and weights file of each extractor whose set metrics can be taken.
    feature_identity : mapping
        The version and checksum behind each of the `features`, and the device but for the CPU.
    environment : mapping
        What images depend on beside our own code: GL driver and library versions.
    shard : Shard or None
        The part of a run that this is; None for a whole run.
    export : str or None
        Checksum of the export that the dataset is; None for another dataset.
    """

    suite: Suite
    dataset: str
    methods: Mapping[str, Method]
    conditions: tuple[str, ...]
    objects: tuple[SceneObject, ...]
    views: int
    seed: int
    device: str
    features: tuple[tuple[str, str], ...]
    feature_identity: Mapping[str, str]
    environment: Mapping[str, str]
    shard: Shard | None = None
    export: str | None = None


def name_of(obj: SceneObject) -> str:
    """Return class and name of an object, as manifests have them."""
    return f"{obj.class_name}/{obj.object_id}"


def find_methods(addresses: Iterable[str]) -> dict[str, Method]:
    """Return methods by id, in order.

    Raises BadInput as `bench.catalogue.methods.find_run_method`, and for two methods of one id.
    """
    methods: dict[str, Method] = {}
    for address in addresses:
        method = find_run_method(address)
        if method.id in methods:
            raise BadInput(
                f"{address}: name {method.id!r} is that of {methods[method.id].address}, too; give "
                "one of them another name"
            )
        methods[method.id] = method
    return methods


def with_floor(methods: Sequence[str]) -> tuple[str, ...]:
    """Return each method once, and the floor, whose images stand for failures in scores."""
    unique = tuple(dict.fromkeys(methods))
    return unique if FLOOR in unique else (*unique, FLOOR)


def method_identity(method: Method, device: str) -> list[Any]:
    """Return everything that the images of a method depend on beside the cloud and the views.

    Raises BadInput for weights that cannot be used.
    """
    return [method.version, method.identity(), device]


def protocol_of(
    suite: Suite, options: Options, probe: Callable[[], Mapping[str, str]] | None = None
) -> tuple[Protocol, dict[str, str]]:
    """Return the protocol of a run, and the metrics that cannot be taken, with the reasons.

    The suite of the protocol has the truth of the options. A line on stderr names methods of the
    suite that are left out for it, and those that join. `probe` finds out the environment (default:
    `bench.running.environment.environment`). Raises BadInput for options that cannot be met, and
    MissingDependency where nothing can be drawn.
    """
    in_colours, suite = suite, with_truth(suite, options.truth)
    if options.inception_weights and FID not in suite.extractors:
        raise BadInput(
            f"--inception-weights: {suite.id} takes no fid against {TRUTHS[suite.truth]}; leave it"
        )
    if suite is not in_colours and not options.methods:
        _name_left_out(in_colours)
    methods = find_methods(with_floor(options.methods or suite.methods))
    for method_id in methods:
        if problem := plugin_problem("method", method_id):  # ours is run
            log(problem)
    conditions = tuple(dict.fromkeys(options.conditions or suite.conditions))
    for condition in conditions:
        find_condition(condition)
        if problem := plugin_problem("condition", condition):  # ours is run
            log(problem)
    refuse_counts(options)
    refuse_absent_gpu(options)
    dataset = open_dataset(options.dataset)
    if dataset.left_out:
        log(f"{dataset.id}: left out, no objects of it: {dataset.left_out}")
    seed = seed_of(dataset, options)
    objects = objects_of(suite, dataset, options)
    for method in methods.values():
        if method.images and (line := method.images.unused(objects, conditions)):
            log(line)
    lacking = [name for name in suite.classes if name not in (dataset.classes or suite.classes)]
    if lacking and len(suite.classes) > 1:
        log(f"{dataset.id}: no {', '.join(lacking)}; left out")
    device = device_of(options)
    features, identity, skipped = extractors_of(suite.extractors, options.inception_weights, device)
    protocol = Protocol(
        suite=suite,
        dataset=dataset.id,
        methods=methods,
        conditions=conditions,
        objects=objects,
        shard=options.shard,
        views=options.views or suite.views,
        seed=seed,
        device=device,
        features=features,
        feature_identity=identity,
        environment=(probe or environment)(),
        export=dataset.checksum,
    )
    return protocol, skipped


def extractors_of(
    metrics: Iterable[str], inception_weights: str | None, device: str
) -> tuple[tuple[tuple[str, str], ...], dict[str, str], dict[str, str]]:
    """Return features and identities as a protocol has them, and the reasons of those without."""
    on_gpu = f" {GPU}" * (metrics_device(device) == GPU)
    features: list[tuple[str, str]] = []
    identity: dict[str, str] = {}
    skipped: dict[str, str] = {}
    for metric in metrics:
        try:
            extractor = find_extractor(metric)
            weights = extractor.weights(inception_weights)
        except WeightsUnavailable as error:
            skipped[metric] = f"skipped: {error}"
            continue
        features.append((metric, str(weights)))
        identity[metric] = f"{extractor.version} {file_sha256(weights)}{on_gpu}"
    return tuple(features), identity, skipped


def _name_left_out(suite: Suite) -> None:
    by_reason: dict[str, list[str]] = {}
    for method_id, reason in left_out_in_grey(suite).items():
        by_reason.setdefault(reason, []).append(method_id)
    if by_reason:
        names = "; ".join(f"{', '.join(ids)} ({reason})" for reason, ids in by_reason.items())
        others = f"them, or for networks in grey like {RECOMMENDED}"
        if suite.grey_methods:
            names, others = f"{names}, and adds {', '.join(suite.grey_methods)}", "others"
        log(f"--truth grey leaves out {names}: give --methods for {others}")


def objects_of(suite: Suite, dataset: Dataset, options: Options) -> tuple[SceneObject, ...]:
    """Return the objects of a run or of a shard, class by class.

    Raises BadInput for a class that the dataset does not have, and for a shard without objects.
    """
    objects = tuple(
        obj
        for class_name in _classes(suite, dataset)
        for obj in dataset.objects(class_name, options.limit, suite.endless_limit)
    )
    if options.shard is None:
        return objects
    if not (selected := options.shard.select(objects)):
        raise BadInput(
            f"--shard {options.shard}: there are only {len(objects)} objects; make fewer shards"
        )
    return selected


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


def stored_protocol(
    manifest: Mapping[str, Any],
    objects: Iterable[tuple[str, str]],
    methods: Iterable[str],
    conditions: Iterable[str],
) -> Protocol:
    """Return the protocol of a part of a stored run, to plan its jobs again.

    Clouds, views and random numbers of these jobs are those of the run. Their keys are not, for the
    protocol has neither features nor environment.

    Parameters
    ----------
    manifest : mapping
        Manifest of the run.
    objects : iterable of (str, str)
        Class and name of each object; objects that the dataset no longer has are left out.
    methods, conditions : iterable of str

    Raises
    ------
    BadInput
        Where the suite, the dataset, a class or a method is not known here.
    """
    dataset, count = open_dataset(manifest["dataset"]), objects_to_search(manifest)
    wanted = dict.fromkeys(objects)
    return Protocol(
        suite=stored_suite(manifest),
        dataset=dataset.id,
        methods=find_methods(address_of(manifest, method) for method in methods),
        conditions=tuple(conditions),
        objects=tuple(
            obj
            for class_name in dict.fromkeys(class_name for class_name, _ in wanted)
            for obj in dataset.objects(class_name, None, count)
            if (obj.class_name, obj.object_id) in wanted
        ),
        views=manifest["views"],
        seed=manifest["seed"],
        device=manifest["device"],
        features=(),
        feature_identity={},
        environment={},
        export=dataset.checksum,
    )


def objects_to_search(manifest: Mapping[str, Any]) -> int:
    """Return how many objects of a class include all objects of the run with this manifest."""
    name = manifest.get("shard")
    # In a run that was stopped, the complete objects need not be the first that were planned.
    count = max(len(manifest["objects"]), manifest.get("planned", 0))
    return count * (read_shard(name).count if name else 1)


def describe(
    protocol: Protocol, workers: int, skipped_metrics: Mapping[str, str]
) -> dict[str, Any]:
    """Return the manifest of a run of a suite of jobs."""
    return manifest_of(
        protocol,
        protocol.suite.id,
        protocol.views,
        protocol.environment,
        shard=str(protocol.shard) if protocol.shard else WHOLE,
        methods=list(protocol.methods),
        identities={
            id_: method_identity(m, protocol.device) for id_, m in protocol.methods.items()
        },
        objectives=objectives(protocol.methods.values()),
        **manifest_entry(
            {
                id_: (m.images.root, m.images.claims)
                for id_, m in protocol.methods.items()
                if m.images
            }
        ),
        **truth_entry(protocol.suite),
        conditions=list(protocol.conditions),
        **_condition_identities(protocol),
        objects=[name_of(obj) for obj in protocol.objects],
        skipped_metrics=dict(skipped_metrics),
        feature_identity=dict(protocol.feature_identity),
        workers=workers,
    )


def _condition_identities(protocol: Protocol) -> dict[str, dict[str, str]]:
    """Return the entry for what clouds of other packages' conditions depend on; none without."""
    others = [name for name in protocol.conditions if name in condition_ids()]
    keys = {name: find_condition(name).key for name in others}
    return {CONDITION_IDENTITIES: keys} if keys else {}


def manifest_of(
    request: Protocol | Options,
    suite: str,
    views: int,
    environment: Mapping[str, str],
    **entries: object,
) -> dict[str, Any]:
    """Return the manifest of a run of any suite; `entries` are those of this kind of suite."""
    repeated = {"request": request.request} if isinstance(request, Options) else {}
    return {
        "schema_version": SCHEMA_VERSION,
        PROTOCOL_ENTRY: PROTOCOL_VERSION,
        **repeated,
        "suite": suite,
        "dataset": request.dataset,
        "views": views,
        "seed": request.seed or 0,
        "device": request.device,
        **entries,
        "environment": dict(environment),
    } | machine_info()
