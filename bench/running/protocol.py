"""The protocol of a run: what is measured, from options or a manifest, and as a manifest."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from bench.catalogue.conditions import find_condition
from bench.catalogue.loaders import GPU
from bench.catalogue.lookup import find
from bench.catalogue.method_files import told_files
from bench.catalogue.methods import (
    FLOOR,
    RECOMMENDED,
    Method,
    find_run_method,
    is_module_name,
    objectives,
)
from bench.catalogue.metrics import FID, WeightsUnavailable, find_extractor, metrics_device
from bench.catalogue.plugins import plugin_problem
from bench.catalogue.suites import (
    SUITES,
    TRUTHS,
    Suite,
    left_out_in_grey,
    stored_suite,
    truth_entry,
    with_truth,
)
from bench.entered.claims import address_of, manifest_entry
from bench.metrics.inception_weights import DOWNLOAD, WEIGHTS_SHA256
from bench.records.folder import CONDITION_IDENTITIES, FIXED
from bench.records.folder import PROTOCOL as PROTOCOL_ENTRY
from bench.records.job import SCHEMA_VERSION
from bench.running.environment import environment, machine_info
from bench.running.options import Options, device_of, refuse_values, seed_of
from data_prep.datasets.objects import SceneObject
from data_prep.datasets.protocol_version import PROTOCOL_VERSION
from data_prep.datasets.registry import Dataset, open_dataset
from data_prep.failures import BadInput
from data_prep.files.checksums import file_sha256
from data_prep.plugins import announced
from data_prep.progress import log


@dataclass(frozen=True)
class Protocol:
    """The decisions behind the values of a run: equal ones give equal tables on one machine."""

    suite: Suite  # with the truth of the run
    dataset: str
    methods: Mapping[str, Method]  # by id, in the order of the tables
    conditions: tuple[str, ...]
    objects: tuple[SceneObject, ...]
    views: int  # images of each object
    seed: int
    device: str  # where networks run: "cpu", "cuda", or "auto" where `device_of` leaves it
    # Id and weights file of each extractor whose set metrics can be taken, and by id the version
    # and checksum behind it, and the device but for the CPU.
    features: tuple[tuple[str, str], ...]
    feature_identity: Mapping[str, str]
    environment: Mapping[str, str]  # what images depend on beside our code: driver and libraries
    skipped: Mapping[str, str] = field(default_factory=dict)  # metrics, and why they are not taken
    export: str | None = None  # checksum of the export that the dataset is

    @cached_property
    def identities(self) -> dict[str, list[Any]]:
        """Return the identities of the methods by id; unusable weights are refused."""
        return {id_: method_identity(m, self.device) for id_, m in self.methods.items()}

    @property
    def names(self) -> list[str]:
        """Return class and name of each object, as manifests have them."""
        return list(map(name_of, self.objects))

    @classmethod
    def from_options(
        cls,
        options: Options,
        probe: Callable[[], Mapping[str, str]] | None = None,
        fetches: bool = True,
    ) -> Protocol:
        """Return the protocol that options ask for, whatever their folder holds.

        Lines on stderr name what is left out. Nothing is written. `probe` finds out the
        environment. Without `fetches`, weights that the run would download count as present.
        Raises BadInput for options that cannot be met, and MissingDependency.
        """
        suite = _suite_of(options)
        methods = find_methods(with_floor(options.methods or suite.methods))
        conditions = tuple(dict.fromkeys(options.conditions or suite.conditions))
        for condition in conditions:
            find_condition(condition)
        _log_all(plugin_problem("method", name) for name in methods)  # ours is run
        _log_all(
            told_files(name, method.declared_files)
            for name, method in methods.items()
            if is_module_name(name)
        )
        _log_all(plugin_problem("condition", name) for name in conditions)
        refuse_values(options)
        device = device_of(options)
        dataset = open_dataset(options.dataset)
        seed = seed_of(dataset, options)
        if dataset.left_out:
            log(f"{dataset.id}: left out, no objects of it: {dataset.left_out}")
        objects = objects_of(suite, dataset, options)
        _log_all(m.images.unused(objects, conditions) for m in methods.values() if m.images)
        lacking = [name for name in suite.classes if name not in (dataset.classes or suite.classes)]
        if lacking and len(suite.classes) > 1:
            log(f"{dataset.id}: no {', '.join(lacking)}; left out")
        features, identity, skipped = extractors_of(
            suite.extractors, options.inception_weights, device, fetches
        )
        return cls(
            suite=suite,
            dataset=dataset.id,
            methods=methods,
            conditions=conditions,
            objects=objects,
            views=options.views or suite.views,
            seed=seed,
            device=device,
            features=features,
            feature_identity=identity,
            environment=(probe or environment)(),
            skipped=skipped,
            export=dataset.checksum,
        )

    @classmethod
    def from_manifest(
        cls,
        manifest: Mapping[str, Any],
        methods: Iterable[str] | None = None,
        conditions: Iterable[str] | None = None,
        objects: Iterable[str] | None = None,
    ) -> Protocol:
        """Return the protocol of a stored run or of a part of it, to plan its jobs again.

        Clouds, views and random numbers of these jobs are those of the run. Their keys are not, for
        the protocol has neither features nor environment. Objects ("class/name") that the dataset
        no longer has are left out; other unknown names are refused.
        """
        names = manifest["methods"] if methods is None else methods
        suite, dataset = stored_suite(manifest), open_dataset(manifest["dataset"])
        wanted = {*(manifest["objects"] if objects is None else objects)}
        return cls(
            suite=suite,
            dataset=dataset.id,
            methods=find_methods(address_of(manifest, name) for name in names),
            conditions=tuple(manifest["conditions"] if conditions is None else conditions),
            objects=find_objects(suite, dataset, wanted, objects_to_search(manifest)),
            views=manifest["views"],
            seed=manifest["seed"],
            device=manifest["device"],
            features=(),
            feature_identity={},
            environment={},
            export=dataset.checksum,
        )

    def to_manifest(
        self,
        request: Mapping[str, Any],
        planned: int,
        workers: int,
        cluster: Mapping[str, Any] | None = None,
    ) -> dict[str, Any]:
        """Return the manifest that the run has when all its objects are complete.

        request  the options that repeat the run
        planned  objects that the run is to have; those of the entry "objects" are complete
        """
        trees = {k: (m.images.root, m.images.claims) for k, m in self.methods.items() if m.images}
        others = {n: find_condition(n).key for n in self.conditions if n in announced("condition")}
        of_packages: dict[str, Any] = {CONDITION_IDENTITIES: others} if others else {}
        return manifest_of(
            request=request,
            environment=self.environment,
            **self.fixed,
            methods=list(self.methods),
            identities=self.identities,
            objectives=objectives(self.methods.values()),
            **manifest_entry(trees),
            conditions=list(self.conditions),
            **of_packages,
            objects=self.names,
            skipped_metrics=dict(self.skipped),
            feature_identity=dict(self.feature_identity),
            workers=workers,
            cluster=cluster,
            planned=planned,
        )

    @property
    def fixed(self) -> dict[str, Any]:
        """Return the entries of the manifest that all runs of one folder share."""
        named = {name: getattr(self, name) for name in FIXED}
        return named | {"suite": self.suite.id} | truth_entry(self.suite)


def manifest_of(
    *,
    request: Mapping[str, Any],
    environment: Mapping[str, str],
    suite: str,
    dataset: str,
    views: int,
    seed: int,
    device: str,
    **entries: object,
) -> dict[str, Any]:
    """Return the manifest of a run of any suite; `entries` are those of this kind of suite."""
    return {
        "schema_version": SCHEMA_VERSION,
        PROTOCOL_ENTRY: PROTOCOL_VERSION,
        "request": dict(request),
        "suite": suite,
        "dataset": dataset,
        "views": views,
        "seed": seed,
        "device": device,
        **entries,
        "environment": dict(environment),
    } | machine_info()


def name_of(obj: SceneObject) -> str:
    """Return class and name of an object, as manifests have them."""
    return f"{obj.class_name}/{obj.object_id}"


def find_methods(addresses: Iterable[str]) -> dict[str, Method]:
    """Return methods by id, in order. Raises BadInput, also for two methods of one id."""
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
    """Return everything that the images of a method depend on beside the cloud and the views."""
    return [method.version, method.identity(), device]


def _suite_of(options: Options) -> Suite:
    """Return the suite of a run with its truth, and name on stderr what is left out for it."""
    in_colours = find(options.suite, SUITES, "suite")
    suite = with_truth(in_colours, options.truth)
    if options.inception_weights and FID not in suite.extractors:
        raise BadInput(
            f"--inception-weights: {suite.id} takes no fid against {TRUTHS[suite.truth]}; leave it"
        )
    by_reason: dict[str, list[str]] = {}
    if suite is not in_colours and not options.methods:
        for method_id, reason in left_out_in_grey(in_colours).items():
            by_reason.setdefault(reason, []).append(method_id)
    if by_reason:
        names = "; ".join(f"{', '.join(ids)} ({reason})" for reason, ids in by_reason.items())
        others = f"them, or for networks in grey like {RECOMMENDED}"
        if in_colours.grey_methods:
            names, others = f"{names}, and adds {', '.join(in_colours.grey_methods)}", "others"
        log(f"--truth grey leaves out {names}: give --methods for {others}")
    return suite


def _log_all(lines: Iterable[str | None]) -> None:
    for line in filter(None, lines):
        log(line)


def extractors_of(
    metrics: Iterable[str], inception_weights: str | None, device: str, fetches: bool = True
) -> tuple[tuple[tuple[str, str], ...], dict[str, str], dict[str, str]]:
    """Return features and identities as a protocol has them, and why some are skipped."""
    on_gpu = f" {GPU}" * (metrics_device(device) == GPU)
    features: list[tuple[str, str]] = []
    identity: dict[str, str] = {}
    skipped: dict[str, str] = {}
    is_later = inception_weights == DOWNLOAD and not fetches
    for metric in metrics:
        extractor = find_extractor(metric)
        try:
            weights = extractor.weights(None if is_later else inception_weights)
            path, checksum = str(weights), file_sha256(weights)
        except WeightsUnavailable as error:
            if metric != FID or not is_later:
                skipped[metric] = f"skipped: {error}"
                continue
            path, checksum = "to be downloaded first", WEIGHTS_SHA256
        features.append((metric, path))
        identity[metric] = f"{extractor.version} {checksum}{on_gpu}"
    return tuple(features), identity, skipped


def objects_of(suite: Suite, dataset: Dataset, options: Options) -> tuple[SceneObject, ...]:
    """Return the objects of a run, class by class; refuse a dataset without."""
    classes = suite.classes
    if len(classes) > 1 and not dataset.classes:
        raise BadInput(
            f"{dataset.id}: {suite.id} compares classes, and this dataset has none; give a "
            "folder whose sub-folders are classes"
        )
    if len(classes) > 1:  # the dataset refuses the first one, with what it has
        classes = tuple(name for name in classes if name in dataset.classes) or classes[:1]
    limits = options.limit, suite.endless_limit
    return tuple(obj for name in classes for obj in dataset.objects(name, *limits))


def objects_to_search(manifest: Mapping[str, Any]) -> int:
    """Return how many objects of a class include all objects of the run with this manifest."""
    # In a run that was stopped, the complete objects need not be the first that were planned.
    return max(len(manifest["objects"]), manifest["planned"])


def find_objects(
    suite: Suite, dataset: Dataset, names: Collection[str], count: int
) -> tuple[SceneObject, ...]:
    """Return the objects with these names, as the dataset orders them, of the first of a class."""
    classes = {name.partition("/")[0] for name in names}
    return tuple(
        obj
        for class_name in suite.classes
        if not dataset.classes or class_name in classes
        for obj in dataset.objects(class_name, None, count)
        if name_of(obj) in names
    )
