"""The protocol of a run: what is measured, from options or a manifest, and as a manifest.

A folder only grows: a run measures what is asked for and, by name, what the tables there have. Its
manifest and tables stay those of the run before until the wider run has all their objects; so a
run that is stopped, or killed, leaves them as they were.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from bench.catalogue.conditions import find_condition
from bench.catalogue.images import address_of, manifest_entry
from bench.catalogue.loaders import GPU
from bench.catalogue.lookup import find
from bench.catalogue.method import is_module_name
from bench.catalogue.method_files import told_files
from bench.catalogue.methods import (
    FLOOR,
    RECOMMENDED,
    Method,
    find_method,
    find_run_method,
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
from bench.metrics.inception_weights import DOWNLOAD, WEIGHTS_SHA256
from bench.records.record import SCHEMA_VERSION
from bench.records.run_folder import CONDITION_IDENTITIES, FIXED, check_directory
from bench.records.run_folder import PROTOCOL as PROTOCOL_ENTRY
from bench.records.store import STORE, open_store
from bench.running.environment import environment, machine_info
from bench.running.options import REPEATED, Options, device_of, refuse_values, seed_of
from data_prep.datasets.objects import SceneObject
from data_prep.datasets.protocol_version import PROTOCOL_VERSION
from data_prep.datasets.registry import Dataset, open_dataset
from data_prep.failures import BadInput
from data_prep.files.checksums import file_sha256
from data_prep.plugins import announced
from data_prep.progress import log

APART = "give --out for a run of its own, or --fresh to start over"
NOT_LOADED = "of a module that this command does not name"  # source of such a method


@dataclass(frozen=True)
class Protocol:
    """The measurements of a run. Equal protocols give equal tables on one machine."""

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
    # The options that were given, as `bench run --config` reads them.
    asked: Mapping[str, Any] = field(default_factory=dict, compare=False)
    export: str | None = None  # checksum of the export that the dataset is
    # The manifest that the folder had when this was decided, the objects that its tables have and
    # are to keep, and how many objects the run is to have at last, where these are not all.
    before: Mapping[str, Any] = field(default_factory=dict)
    shown: frozenset[str] = frozenset()
    planned: int | None = None

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
        """Return the protocol of a run: what the options ask for, and what its folder has.

        Lines on stderr name what is left out, and what the folder has beside. Nothing is written.
        `probe` finds out the environment. Without `fetches`, weights that the run would download
        count as present. Raises BadInput for options that cannot be met, and for a folder with
        something else or with a part that is not known here, and MissingDependency.
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
        asked = cls(
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
            asked=options.request,
            export=dataset.checksum,
        )
        if options.fresh:
            return asked
        return _with_folder(asked, options.directory, options.same_objects)

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
            objects=_find_objects(suite, dataset, wanted, objects_to_search(manifest)),
            views=manifest["views"],
            seed=manifest["seed"],
            device=manifest["device"],
            features=(),
            feature_identity={},
            environment={},
            export=dataset.checksum,
        )

    def to_manifest(self, workers: int, cluster: Mapping[str, Any] | None = None) -> dict[str, Any]:
        """Return the manifest that the run has when all its objects are complete."""
        trees = {k: (m.images.root, m.images.claims) for k, m in self.methods.items() if m.images}
        others = {n: find_condition(n).key for n in self.conditions if n in announced("condition")}
        return manifest_of(
            self,
            self.suite.id,
            self.views,
            self.environment,
            **self.fixed,
            methods=list(self.methods),
            identities=self.identities,
            objectives=objectives(self.methods.values()),
            **manifest_entry(trees),
            conditions=list(self.conditions),
            **({CONDITION_IDENTITIES: others} if others else {}),
            objects=self.names,
            skipped_metrics=dict(self.skipped),
            feature_identity=dict(self.feature_identity),
            workers=workers,
            cluster=cluster,
            planned=self.planned or len(self.objects),  # "objects" will be those that are complete
        )

    @property
    def fixed(self) -> dict[str, Any]:
        """Return the entries of the manifest that all runs of one folder share."""
        named = {name: getattr(self, name) for name in FIXED}
        return named | {"suite": self.suite.id} | truth_entry(self.suite)

    @property
    def request(self) -> dict[str, Any]:
        """Return the options that repeat the run, also those that were left to defaults."""
        classes = [obj.class_name for obj in self.objects]
        stated = {
            **self.asked,
            "methods": [method.address for method in self.methods.values()],
            "conditions": list(self.conditions),
            "views": self.views,
            "seed": self.seed,
            "limit": max(map(classes.count, {*classes})),
        }
        if self.planned:
            stated |= {k: v for k, v in self.before["request"].items() if k == "limit"}
        return {name: stated[name] for name in REPEATED if name in stated}


def manifest_of(
    asked: Protocol | Options,
    suite: str,
    views: int,
    environment: Mapping[str, str],
    /,
    **entries: object,
) -> dict[str, Any]:
    """Return the manifest of a run of any suite; `entries` are those of this kind of suite."""
    return {
        "schema_version": SCHEMA_VERSION,
        PROTOCOL_ENTRY: PROTOCOL_VERSION,
        "request": asked.request,
        "suite": suite,
        "dataset": asked.dataset,
        "views": views,
        "seed": asked.seed or 0,
        "device": asked.device,
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


def _find_objects(
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


def _with_folder(asked: Protocol, directory: Path, same_objects: bool) -> Protocol:
    """Return a protocol with the methods, conditions and objects of the tables in a folder.

    With `same_objects` the objects are those alone.
    """
    before = check_directory(directory, asked.fixed)
    with open_store(directory) as store:
        if not before.get("finished") and next(store.listed(), None) is None:
            return replace(asked, before=before)  # it was stopped before it had tables
        is_emptied = store.is_empty
    suite, shown = asked.suite, frozenset(before["objects"])
    methods = {**asked.methods, **methods_there(directory, asked.device, before, asked.methods)}
    order = joined(tuple(asked.methods), before["methods"], suite.methods)
    wanted = shown if same_objects else shown.union(asked.names)
    wide = replace(
        asked,
        methods={name: methods[name] for name in order},
        conditions=joined(asked.conditions, before["conditions"], suite.conditions),
        objects=_objects_there(asked, directory, before, wanted),
        before=before,
        shown=shown,
        planned=before["planned"] if same_objects else None,
    )
    if not same_objects:  # else to keep them is what was asked for
        kinds = ("methods", "conditions", "objects")
        tell_kept(directory, {k: len(getattr(wide, k)) - len(getattr(asked, k)) for k in kinds})
    was = {**before["environment"], **before["feature_identity"]}
    now = {**asked.environment, **asked.feature_identity}
    if changed := [name for name in {**was, **now} if was.get(name) != now.get(name)]:
        log(f"{directory}: was made with another {', '.join(changed)}; all its jobs are done again")
    if is_emptied:
        log(f"{directory}: {STORE} has none of its finished jobs any more; all are done again")
    return wide


def _objects_there(
    asked: Protocol, directory: Path, before: Mapping[str, Any], wanted: Collection[str]
) -> tuple[SceneObject, ...]:
    """Return the wanted objects, as the dataset orders them; refuse where one is gone."""
    if {*asked.names} == wanted:
        return asked.objects
    count = max(objects_to_search(before), len(asked.objects))
    objects = _find_objects(asked.suite, open_dataset(asked.dataset), wanted, count)
    if lost := sorted({*wanted} - {*map(name_of, objects)}):
        raise BadInput(
            f"{directory}: the run there has {lost[0]} ({len(lost)} in all), which {asked.dataset} "
            f"no longer has; bring it back, {APART}"
        )
    return objects


def joined(asked: Sequence[str], kept: Sequence[str], listed: Sequence[str]) -> tuple[str, ...]:
    """Return the names of both, in the order of the one that has all names.

    Where neither has all, the names that are `listed` come first, as they are listed there.
    """
    if {*kept} <= {*asked}:
        return tuple(asked)
    every = dict.fromkeys((*kept, *asked))
    if {*asked} <= {*kept}:
        return tuple(every)
    return (*(name for name in listed if name in every), *(n for n in every if n not in listed))


def tell_kept(directory: Path, more: Mapping[str, int]) -> None:
    """Say on stderr how many methods, conditions and objects a folder has beyond the request."""
    if lines := [counted(n, kind) for kind, n in more.items() if n]:
        log(f"{directory}: keeps {', '.join(lines)} of the run there; {APART}")


def counted(count: int, kind: str) -> str:
    """Return a number with its noun, as in "1 more method"."""
    return f"{count} more {kind if count > 1 else kind.removesuffix('s')}"


def methods_there(
    directory: Path, device: str, before: Mapping[str, Any], asked: Collection[str]
) -> dict[str, Method]:
    """Return the methods of the run in a folder beside those that are asked for, by id.

    A method MODULE:NAME is known by its identity alone, where the manifest has `identities`: its
    finished jobs stay, and nothing is executed because a manifest names it. What is not known or
    cannot be used here is refused.
    """
    methods: dict[str, Method] = {}
    try:
        for name in sorted({*before["methods"]} - {*asked}):
            identity = before.get("identities", {}).get(name)
            if identity is not None and is_module_name(name):
                version, text, _ = identity
                methods[name] = Method(
                    name,
                    load=lambda device, name=name: find_method(name).load(device),  # refuses it
                    identity=lambda text=text: str(text),
                    version=int(version),
                    source=NOT_LOADED,
                )
                continue
            methods[name] = find_run_method(address_of(before, name))
            method_identity(methods[name], device)
        for condition in before.get("conditions", ()):
            find_condition(condition)
    except BadInput as error:
        # The list of all known names would hide the remedy.
        reason = str(error).partition(": ")[0] if str(error).startswith("unknown") else str(error)
        raise BadInput(
            f"{directory}: its run cannot be kept here: {reason}; install what is missing, {APART}"
        ) from error
    return methods
