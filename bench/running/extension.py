"""A run joined with the one that its folder already has: methods, conditions and objects only grow.

The manifest and the tables of the folder stay those of the run before until the wider run has all
their objects; so an extension that is stopped, or killed, leaves them as they were.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from bench.catalogue.conditions import find_condition
from bench.catalogue.images import address_of
from bench.catalogue.method import is_module_name
from bench.catalogue.methods import Method, find_method, find_run_method
from bench.catalogue.suites import truth_entry
from bench.records.run_folder import (
    MANIFEST,
    SHARD,
    check_directory,
    read_manifest,
    read_store,
)
from bench.records.store import STORE, Store
from bench.running.options import Options
from bench.running.plan import ObjectJobs, Plan, plan
from bench.running.protocol import WHOLE, Protocol, method_identity, name_of, objects_to_search
from data_prep.datasets.objects import SceneObject
from data_prep.datasets.registry import open_dataset
from data_prep.failures import BadInput
from data_prep.progress import log

APART = "give --out for a run of its own, or --fresh to start over"


@dataclass(frozen=True)
class KeptRun:
    """The run of a folder that a further run must not narrow.

    Attributes
    ----------
    methods : mapping
        The methods by id.
    conditions : tuple of str
    objects : frozenset of str
        Class and name of each complete object.
    manifest : mapping
        The manifest as it was read.
    """

    methods: Mapping[str, Method]
    conditions: tuple[str, ...]
    objects: frozenset[str]
    manifest: Mapping[str, Any]

    def with_intention(self, manifest: Mapping[str, Any]) -> dict[str, Any]:
        """Return a manifest whose run is to have as many objects at last as this one was."""
        intended = {k: v for k, v in self.manifest.items() if k == "planned"}
        limit = {k: v for k, v in self.manifest["request"].items() if k == "limit"}
        return {**manifest, **intended, "request": manifest["request"] | limit}


def join(options: Options, protocol: Protocol) -> tuple[Protocol, KeptRun | None]:
    """Return the protocol widened by the run in the folder, and that run.

    The run is None for a folder without one, with `--fresh`, and where nothing of it is complete. A
    line on stderr says what the folder has beyond the request. Nothing is written. Raises BadInput
    where the folder holds something else, and where a part of its run is not known here, so that it
    could not be kept.
    """
    directory = options.directory
    if options.fresh:
        return protocol, None
    check_directory(directory, _fixed(protocol))
    if not (directory / MANIFEST).is_file():
        return protocol, None
    kept = _kept(directory, protocol, read_manifest(directory))
    if kept is None:
        return protocol, None
    every_method = {**kept.methods, **protocol.methods}
    ids = joined(tuple(protocol.methods), tuple(kept.methods), protocol.suite.methods)
    if options.same_objects:
        chosen = tuple(obj for obj in protocol.objects if name_of(obj) in kept.objects)
        protocol = replace(protocol, objects=chosen)
    wide = replace(
        protocol,
        methods={method_id: every_method[method_id] for method_id in ids},
        conditions=joined(protocol.conditions, kept.conditions, protocol.suite.conditions),
        objects=_with_kept(directory, protocol, kept),
    )
    if not options.same_objects:  # else to keep them is what was asked for
        kinds = ("methods", "conditions", "objects")
        more = (len(getattr(wide, kind)) - len(getattr(protocol, kind)) for kind in kinds)
        _tell(directory, list(map(_counted, more, kinds)))
    _tell_changes(directory, kept.manifest, wide)
    with read_store(directory) as store:
        if store.is_empty:
            log(f"{directory}: {STORE} has none of its finished jobs any more; all are done again")
    return wide, kept


def pinned_request(options: Options, protocol: Protocol) -> dict[str, Any]:
    """Return the request of a run with everything stated that `options` leave to defaults.

    The limit of a shard is that of the whole run, which its own objects do not tell.
    """
    names = [obj.class_name for obj in protocol.objects]
    limit = max(map(names.count, {*names}))
    return replace(
        options,
        methods=tuple(method.address for method in protocol.methods.values()),
        conditions=protocol.conditions,
        limit=options.limit if protocol.shard else limit,
        views=protocol.views,
        seed=protocol.seed,
    ).request


def joined(asked: tuple[str, ...], kept: tuple[str, ...], listed: Sequence[str]) -> tuple[str, ...]:
    """Return the names of both, in the order of the one that has all names.

    Where neither has all, the names that are `listed` come first, as they are listed there.
    """
    if set(kept) <= set(asked):
        return asked
    if set(asked) <= set(kept):
        return kept
    every = dict.fromkeys((*kept, *asked))
    return (*(name for name in listed if name in every), *(n for n in every if n not in listed))


def with_methods_there(
    options: Options, suite: str, asked: tuple[str, ...], listed: Sequence[str]
) -> tuple[str, ...]:
    """Return the methods of a suite with a procedure of its own, and the methods its folder has.

    Raises BadInput where the folder holds a method that is not known here.
    """
    directory = options.directory
    if options.fresh or not (directory / MANIFEST).is_file():
        return asked
    manifest = read_manifest(directory)
    if manifest["suite"] != suite:  # which is refused before anything is written
        return asked
    kept = tuple(map(str, manifest.get("methods", ())))
    beyond = [name for name in kept if name not in asked]
    _find_kept(directory, options.device, manifest, beyond, ())
    methods = joined(asked, kept, listed)
    _tell(directory, [_counted(len(methods) - len(asked), "methods")])
    return methods


def refuse_narrowing(directory: Path, manifest: Mapping[str, Any]) -> None:
    """Raise BadInput where a run with this manifest would have less than the one in the folder."""
    if not (directory / MANIFEST).is_file():
        return
    before = read_manifest(directory)
    for kind in ("methods", "conditions", "objects", "pairs", "triples"):
        if lacking := [name for name in before.get(kind, ()) if name not in manifest.get(kind, ())]:
            raise BadInput(
                f"{directory}: holds a run with {_counted(len(lacking), kind)}, {lacking[0]} among "
                "them; give a new --out"
            )


def _tell(directory: Path, more: Sequence[str]) -> None:
    if any(more):
        log(f"{directory}: keeps {', '.join(filter(None, more))} of the run there; {APART}")


def _tell_changes(directory: Path, manifest: Mapping[str, Any], protocol: Protocol) -> None:
    """Say on stderr why no job of the run in the folder can stay, where that is so."""
    before = {**manifest.get("environment", {}), **manifest.get("feature_identity", {})}
    now = {**protocol.environment, **protocol.feature_identity}
    if changed := [name for name in {**before, **now} if before.get(name) != now.get(name)]:
        log(f"{directory}: was made with another {', '.join(changed)}; all its jobs are done again")


def refuse_lost_modules(directory: Path, asked: Protocol, planned: Plan) -> None:
    """Raise BadInput where a method has jobs left and its module is not named by the command.

    `asked` is the protocol of the command, without what its folder has beside.
    """
    lost = {id_ for id_ in planned.protocol.methods if is_module_name(id_)} - {*asked.methods}
    if not lost:
        return
    with read_store(directory) as store:
        for obj in planned:
            keys = {job.key: job.method for job in obj.jobs if job.method in lost}
            if left := sorted({keys[key] for key in keys.keys() - store.find(keys).keys()}):
                raise BadInput(
                    f"{directory}: {left[0]} has jobs left, and its module is executed only where "
                    f"the command names it; name it, too, {APART}"
                )


def _fixed(protocol: Protocol) -> dict[str, Any]:
    return {
        "suite": protocol.suite.id,
        "dataset": protocol.dataset,
        "views": protocol.views,
        "seed": protocol.seed,
        "device": protocol.device,
        SHARD: str(protocol.shard) if protocol.shard else WHOLE,
        **truth_entry(protocol.suite),
    }


def _kept(directory: Path, protocol: Protocol, manifest: Mapping[str, Any]) -> KeptRun | None:
    """Return the run that the tables of a folder show.

    A run that was killed, perhaps while its tables were made again, counts with the objects that
    are complete; None where none is.
    """
    ids, conditions, objects = (
        tuple(map(str, manifest.get(kind, ()))) for kind in ("methods", "conditions", "objects")
    )
    finished = manifest.get("finished")
    same = {*ids} == {*protocol.methods} and {*conditions} == {*protocol.conditions}
    if not finished and same and {*objects} <= {name_of(obj) for obj in protocol.objects}:
        return None  # only objects may be added, and those that are complete stay so
    beyond = [name for name in ids if name not in protocol.methods]
    known = {
        **protocol.methods,
        **_find_kept(directory, protocol.device, manifest, beyond, conditions),
    }
    methods = {name: known[name] for name in ids}
    kept = KeptRun(methods, conditions, frozenset(objects), manifest)
    if finished:
        return kept
    stored = tuple(obj for obj in _search(protocol, manifest) if name_of(obj) in kept.objects)
    narrow = replace(protocol, methods=methods, conditions=conditions, objects=stored)
    with read_store(directory) as store:
        complete = frozenset(obj.name for obj in plan(narrow) if is_complete(obj, store))
    return replace(kept, objects=complete) if complete else None


def is_complete(obj: ObjectJobs, store: Store) -> bool:
    """Return whether all jobs of an object are finished."""
    keys = {job.key for job in obj.jobs}
    return len(store.find(keys)) == len(keys)


def _find_kept(
    directory: Path,
    device: str,
    manifest: Mapping[str, Any],
    ids: Iterable[str],
    conditions: Iterable[str],
) -> dict[str, Method]:
    """Return methods of the run in the folder, by id.

    A method MODULE:NAME is known by its identity alone, where the manifest has `identities`: its
    finished jobs stay, and nothing is executed because a manifest names it. Raises BadInput for a
    method that cannot be used here, and for an unknown condition.
    """
    methods = {}
    try:
        for method_id in sorted(ids):
            stored = manifest.get("identities", {}).get(method_id)
            if stored is not None and is_module_name(method_id):
                methods[method_id] = _unloaded(method_id, stored)
                continue
            methods[method_id] = find_run_method(address_of(manifest, method_id))
            method_identity(methods[method_id], device)
        for condition in conditions:
            find_condition(condition)
    except BadInput as error:
        # The list of all known names would hide the remedy.
        reason = str(error).partition(": ")[0] if str(error).startswith("unknown") else str(error)
        raise BadInput(
            f"{directory}: its run cannot be kept here: {reason}; install what is missing, {APART}"
        ) from error
    return methods


def _unloaded(method_id: str, identity: Sequence[Any]) -> Method:
    """Return a method of a module that is not loaded; it can draw nothing."""
    version, text, _ = identity
    return Method(
        method_id,
        load=lambda device: find_method(method_id).load(device),  # which refuses it
        identity=lambda: str(text),
        version=int(version),
        source="of a module that this command does not name",
    )


def _with_kept(directory: Path, protocol: Protocol, kept: KeptRun) -> tuple[SceneObject, ...]:
    """Return the objects of the protocol and of the kept run, as the dataset orders them."""
    wanted = kept.objects | {name_of(obj) for obj in protocol.objects}
    if len(wanted) == len(protocol.objects):
        return protocol.objects
    if protocol.shard is not None:
        raise BadInput(
            f"{directory}: shard {protocol.shard} there has other objects; give its --limit again, "
            f"{APART}"
        )
    objects = tuple(obj for obj in _search(protocol, kept.manifest) if name_of(obj) in wanted)
    if lost := sorted(wanted - {name_of(obj) for obj in objects}):
        raise BadInput(
            f"{directory}: the run there has {lost[0]} ({len(lost)} in all), which "
            f"{protocol.dataset} no longer has; bring it back, {APART}"
        )
    return objects


def _search(protocol: Protocol, manifest: Mapping[str, Any]) -> Iterable[SceneObject]:
    """Yield the objects of the dataset, class by class, as far as both runs can have come."""
    dataset = open_dataset(protocol.dataset)
    count = max(objects_to_search(manifest), len(protocol.objects))
    for class_name in protocol.suite.classes:
        if not dataset.classes or class_name in dataset.classes:
            yield from dataset.objects(class_name, None, count)


def _counted(count: int, kind: str) -> str:
    """Return a number with its noun, as in "1 more method"; an empty text for 0."""
    return f"{count} more {kind if count > 1 else kind.removesuffix('s')}" if count else ""
