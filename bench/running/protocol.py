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
    OWN_MESHES,
    SUITES,
    TRUTHS,
    Suite,
    Truth,
    left_out,
    stored_suite,
    truth_entry,
    with_truth,
)
from bench.entered.claims import address_of, drawn_export, manifest_entry
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
    """The decisions behind the values of a run.

    On one machine equal protocols give equal tables.
    """

    suite: Suite  # the suite with the kind of true images of this run
    dataset: str
    methods: Mapping[str, Method]  # by id, in the order of the tables
    conditions: tuple[str, ...]
    objects: tuple[SceneObject, ...]
    views: int  # images of each object
    seed: int
    device: str  # where networks run: "cpu", "cuda", or "auto" where `device_of` leaves it
    # The id and the weights file of each feature extractor whose distances can be measured.
    features: tuple[tuple[str, str], ...]
    # What the features of each extractor depend on, by its id: its version, the checksum of its
    # weights, and the device where that is not the CPU.
    feature_identity: Mapping[str, str]
    # The graphics driver and the libraries that images depend on, beside our own code.
    environment: Mapping[str, str]
    skipped: Mapping[str, str] = field(default_factory=dict)  # the reason for each skipped metric
    # The checksum of an exported dataset, or of an export of the same inputs; None if unknown.
    export: str | None = None

    @cached_property
    def identities(self) -> dict[str, list[Any]]:
        """Return what the images of each method depend on, by its id (see `method_identity`).

        Raises BadInput for weights that cannot be used.
        """
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

        probe    asks the graphics driver for the environment; by default `environment`
        fetches  whether the run downloads weights that it lacks; where it is False, such weights
                 count as present, with the checksum that they will have

        Lines on stderr name what is left out. Nothing is written. Raises BadInput for options that
        cannot be met, and MissingDependency where nothing can be rendered on this machine.
        """
        suite = _suite_of(options)
        methods = find_methods(with_floor(options.methods or suite.methods))
        conditions = tuple(dict.fromkeys(options.conditions or suite.conditions))
        for condition in conditions:
            find_condition(condition)
        _log_about_plugins(methods, conditions)
        refuse_values(options)
        device = device_of(options)
        dataset = open_dataset(options.dataset)
        seed = seed_of(dataset, options)
        if dataset.left_out:
            log(f"{dataset.id}: left out, no objects of it: {dataset.left_out}")
        objects = objects_of(suite, dataset, options)
        _log_all(m.images.unused(objects, conditions) for m in methods.values() if m.images)
        present = dataset.classes or suite.classes
        lacking = [name for name in suite.classes if name not in present]
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
            export=dataset.checksum or options.export,
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

        methods, conditions, objects  the names of the part; None for all that the run has

        The clouds, views and random numbers of the planned jobs are those of the run. The keys of
        the jobs differ from those of the run, because this protocol has neither features nor
        environment. Objects ("class/name") that the dataset no longer has are left out. Raises
        BadInput for unknown methods, conditions and datasets.
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
            export=dataset.checksum or drawn_export(manifest),
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
        planned  the number of objects that the run is to have; the entry "objects" names those that
                 are complete
        workers  the number of worker processes
        cluster  the Ray cluster that does the jobs; None for this machine
        """
        trees = {k: (m.images.root, m.images.claims) for k, m in self.methods.items() if m.images}
        from_plugins = [name for name in self.conditions if name in announced("condition")]
        of_packages: dict[str, Any] = {}
        if from_plugins:
            of_packages[CONDITION_IDENTITIES] = {n: find_condition(n).key for n in from_plugins}
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
        """Return the entries of the manifest that stay the same for all that a folder will hold."""
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
    """Return the manifest of a run of any suite, with the machine and the time of now.

    `entries` are those that only this kind of suite has.
    """
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
    """Return the name of an object in manifests, which is CLASS/ID."""
    return f"{obj.class_name}/{obj.object_id}"


def find_methods(addresses: Iterable[str]) -> dict[str, Method]:
    """Return the methods at these addresses by id, in the given order.

    Raises BadInput for an unknown address, and where two methods have the same id.
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
    """Return each method once, and at the end the method FLOOR where it is not among them.

    Every run needs FLOOR: its blank images stand in for those of failed jobs when scores are
    summed up.
    """
    unique = tuple(dict.fromkeys(methods))
    return unique if FLOOR in unique else (*unique, FLOOR)


def method_identity(method: Method, device: str) -> list[Any]:
    """Return everything that the images of a method depend on beside the cloud and the views."""
    return [method.version, method.identity(), device]


def _suite_of(options: Options) -> Suite:
    """Return the suite that options name, with the kind of true images that they ask for.

    A line on stderr names the methods that a suite with another truth leaves out, and why. Raises
    BadInput for an unknown suite, and for weights of a network that the suite does not use.
    """
    in_colours = find(options.suite, SUITES, "suite")
    suite = with_truth(in_colours, options.truth or in_colours.default_truth)
    if options.inception_weights and FID not in suite.extractors:
        raise BadInput(
            f"--inception-weights: {suite.id} takes no fid against {TRUTHS[suite.truth]}; leave it"
        )
    if options.truth and suite is not in_colours and not options.methods:
        _log_left_out(in_colours, suite.truth)
    return suite


def _log_left_out(in_colours: Suite, truth: Truth) -> None:
    """Name on stderr the methods that a suite leaves out with another truth, and why."""
    by_reason: dict[str, list[str]] = {}
    for method_id, reason in left_out(in_colours, truth).items():
        by_reason.setdefault(reason, []).append(method_id)
    if not by_reason:
        return
    names = "; ".join(f"{', '.join(ids)} ({reason})" for reason, ids in by_reason.items())
    others = f"them, or for networks in grey like {RECOMMENDED}"
    if in_colours.grey_methods:
        names, others = f"{names}, and adds {', '.join(in_colours.grey_methods)}", "others"
    log(f"--truth {truth} leaves out {names}: give --methods for {others}")


def _log_about_plugins(methods: Mapping[str, Method], conditions: Sequence[str]) -> None:
    """Say on stderr which plug-ins are not used, and by which files methods are known.

    A plug-in that has the name of one of our own methods or conditions is not used. A method
    MODULE:NAME is known by the files that it declares.
    """
    _log_all(plugin_problem("method", name) for name in methods)
    for name, method in methods.items():
        if is_module_name(name):
            _log_all([told_files(name, method.declared_files)])
    _log_all(plugin_problem("condition", name) for name in conditions)


def _log_all(lines: Iterable[str | None]) -> None:
    for line in filter(None, lines):
        log(line)


def extractors_of(
    metrics: Iterable[str], inception_weights: str | None, device: str, fetches: bool = True
) -> tuple[tuple[tuple[str, str], ...], dict[str, str], dict[str, str]]:
    """Return what a protocol says about the feature extractors of some metrics.

    These are its entries `features`, `feature_identity` and `skipped`: the weights file of each
    extractor, what its features depend on, and the reason for each metric whose weights are not
    here. The arguments are as in `Protocol.from_options`.
    """
    on_gpu = f" {GPU}" if metrics_device(device) == GPU else ""
    features: list[tuple[str, str]] = []
    identity: dict[str, str] = {}
    skipped: dict[str, str] = {}
    # Weights that the run will download, but this command does not: they are found in the cache, or
    # they count as present with the checksum that is published.
    is_postponed = inception_weights == DOWNLOAD and not fetches
    for metric in metrics:
        extractor = find_extractor(metric)
        try:
            weights = extractor.weights(None if is_postponed else inception_weights)
            path, checksum = str(weights), file_sha256(weights)
        except WeightsUnavailable as error:
            if metric != FID or not is_postponed:
                skipped[metric] = f"skipped: {error}"
                continue
            path, checksum = "to be downloaded first", WEIGHTS_SHA256
        features.append((metric, path))
        identity[metric] = f"{extractor.version} {checksum}{on_gpu}"
    return tuple(features), identity, skipped


def objects_of(suite: Suite, dataset: Dataset, options: Options) -> tuple[SceneObject, ...]:
    """Return the objects of a run, class by class.

    Raises BadInput for a dataset without classes where the suite compares classes, and for one that
    has no object of the suite's classes.
    """
    classes = _classes_of(suite, dataset)
    if len(classes) > 1 and not dataset.classes:
        raise BadInput(
            f"{dataset.id}: {suite.id} compares classes, and this dataset has none; give a "
            f"folder whose sub-folders are classes, or --suite {OWN_MESHES}"
        )
    if len(classes) > 1:
        present = tuple(name for name in classes if name in dataset.classes)
        # Where none is present, the dataset refuses the first one and names the classes it has.
        classes = present or classes[:1]
    objects: list[SceneObject] = []
    for name in classes:
        objects += dataset.objects(name, options.limit, suite.endless_limit)
    return tuple(objects)


def _classes_of(suite: Suite, dataset: Dataset) -> tuple[str, ...]:
    """Return the classes that a suite asks a dataset for, of which the dataset may lack some."""
    # A dataset without classes gives all its objects, whatever class it is asked for.
    return suite.classes or dataset.classes or ("",)


def objects_to_search(manifest: Mapping[str, Any]) -> int:
    """Return how many objects of each class have to be searched to find all those of a run.

    The run is that of the manifest.
    """
    # The complete objects of a run that was stopped are anywhere among those that were planned.
    return max(len(manifest["objects"]), manifest["planned"])


def find_objects(
    suite: Suite, dataset: Dataset, names: Collection[str], count: int
) -> tuple[SceneObject, ...]:
    """Return the objects with these names ("class/name"), in the order of the dataset.

    Only the first `count` objects of each class are searched.
    """
    named_classes = {name.partition("/")[0] for name in names}
    objects: list[SceneObject] = []
    for class_name in _classes_of(suite, dataset):
        if dataset.classes and class_name not in named_classes:
            continue
        searched = dataset.objects(class_name, None, count)
        objects += [obj for obj in searched if name_of(obj) in names]
    return tuple(objects)
