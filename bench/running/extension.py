"""A run that is joined with what its folder already has: methods, conditions and objects only grow.

The manifest and the tables of the folder stay those of the run before until the wider run has all
that they are of; so an extension that is stopped, or killed, leaves them as they were.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from bench.catalogue.lookup import find
from bench.records.journal import (
    MANIFEST,
    SHARD,
    check_directory,
    read_lines,
    read_manifest,
)
from bench.running.protocol import (
    WHOLE,
    Options,
    Protocol,
    method_identity,
    name_of,
    objects_to_search,
    plan,
)
from data_prep.clouds.conditions import CONDITIONS
from data_prep.datasets.objects import SceneObject
from data_prep.datasets.registry import open_dataset
from data_prep.failures import BadInput
from data_prep.progress import log

APART = "give --out for a run of its own, or --fresh to start over"


@dataclass(frozen=True)
class KeptRun:
    """The run of a folder that a further run must not narrow.

    objects   by class and name
    manifest  as it was read
    """

    methods: tuple[str, ...]
    conditions: tuple[str, ...]
    objects: frozenset[str]
    manifest: Mapping[str, Any]


def join(options: Options, protocol: Protocol) -> tuple[Protocol, KeptRun | None]:
    """Return what is asked for together with what the run in the folder has, and the latter.

    A line on stderr says what the folder has beyond what is asked for. Nothing is written. None
    stands for a folder without a run, with `--fresh`, and for a run of which nothing is complete.
    Raises BadInput where the folder holds something else, and where a part of its run is not known
    here, so that it could not be kept.
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
    _check_known(directory, protocol.device, {*kept.methods} - {*protocol.methods}, kept.conditions)
    wide = replace(
        protocol,
        methods=joined(protocol.methods, kept.methods, protocol.suite.methods),
        conditions=joined(protocol.conditions, kept.conditions, protocol.suite.conditions),
        objects=_with_kept(directory, protocol, kept),
    )
    kinds = ("methods", "conditions", "objects")
    more = (len(getattr(wide, kind)) - len(getattr(protocol, kind)) for kind in kinds)
    _tell(directory, list(map(_counted, more, kinds)))
    return wide, kept


def pinned_request(options: Options, protocol: Protocol) -> dict[str, Any]:
    """Return the request of a run with everything stated that `options` leave to defaults.

    The limit of a shard is that of the whole run, which its own objects do not tell.
    """
    names = [obj.class_name for obj in protocol.objects]
    limit = max(map(names.count, {*names}))
    return replace(
        options,
        methods=protocol.methods,
        conditions=protocol.conditions,
        limit=options.limit if protocol.shard else limit,
        views=protocol.views,
        seed=protocol.seed,
    ).request


def joined(asked: tuple[str, ...], kept: tuple[str, ...], listed: Sequence[str]) -> tuple[str, ...]:
    """Return the names of both: in their own order where one has all, else first as `listed`."""
    if set(kept) <= set(asked):
        return asked
    if set(asked) <= set(kept):
        return kept
    every = dict.fromkeys((*kept, *asked))
    return (*(name for name in listed if name in every), *(n for n in every if n not in listed))


def with_methods_there(
    options: Options, suite: str, asked: tuple[str, ...], listed: Sequence[str]
) -> tuple[str, ...]:
    """Return the methods of a suite with a procedure of its own, with those its folder has.

    Raises BadInput where the folder holds a method that is not known here.
    """
    directory = options.directory
    if options.fresh or not (directory / MANIFEST).is_file():
        return asked
    manifest = read_manifest(directory)
    if manifest["suite"] != suite:  # which is refused before anything is written
        return asked
    kept = tuple(map(str, manifest.get("methods", ())))
    _check_known(directory, options.device, {*kept} - {*asked}, ())
    methods = joined(asked, kept, listed)
    _tell(directory, [_counted(len(methods) - len(asked), "methods")])
    return methods


def refuse_narrowing(directory: Path, manifest: Mapping[str, Any]) -> None:
    """Raise BadInput where a run with this manifest would have less than the one in the folder."""
    if not (directory / MANIFEST).is_file():
        return
    before = read_manifest(directory)
    for kind in ("methods", "conditions", "objects"):
        if lacking := [name for name in before.get(kind, ()) if name not in manifest.get(kind, ())]:
            raise BadInput(
                f"{directory}: holds a run with {_counted(len(lacking), kind)}, {lacking[0]} among "
                "them; give a new --out"
            )


def _tell(directory: Path, more: Sequence[str]) -> None:
    if any(more):
        log(f"{directory}: keeps {', '.join(filter(None, more))} of the run there; {APART}")


def _fixed(protocol: Protocol) -> dict[str, Any]:
    return {
        "suite": protocol.suite.id,
        "dataset": protocol.dataset,
        "views": protocol.views,
        "seed": protocol.seed,
        "device": protocol.device,
        SHARD: str(protocol.shard) if protocol.shard else WHOLE,
    }


def _kept(directory: Path, protocol: Protocol, manifest: Mapping[str, Any]) -> KeptRun | None:
    """Return the run that the tables of a folder show.

    A run that was killed, perhaps while its tables were made again, counts with the objects that
    are complete; None where none is.
    """
    methods, conditions, objects = (
        tuple(map(str, manifest.get(kind, ()))) for kind in ("methods", "conditions", "objects")
    )
    kept = KeptRun(methods, conditions, frozenset(objects), manifest)
    if manifest.get("finished"):
        return kept
    asked = {name_of(obj) for obj in protocol.objects}
    if (
        {*methods} == {*protocol.methods}
        and {*conditions} == {*protocol.conditions}
        and kept.objects <= asked
    ):
        return None  # only objects may be added, and what is complete of them stays so
    _check_known(directory, protocol.device, {*methods} - {*protocol.methods}, conditions)
    stored = tuple(obj for obj in _search(protocol, manifest) if name_of(obj) in kept.objects)
    before = replace(protocol, methods=methods, conditions=conditions, objects=stored)
    lines = read_lines(directory)
    complete = frozenset(
        obj.name
        for obj in plan(before, directory).objects
        if all(job.key in lines for job in obj.jobs)
    )
    return replace(kept, objects=complete) if complete else None


def _check_known(
    directory: Path, device: str, methods: Iterable[str], conditions: Iterable[str]
) -> None:
    """Raise BadInput for a method that cannot be used here, and for an unknown condition."""
    try:
        for method in sorted(methods):
            method_identity(method, device)
        for condition in conditions:
            find(condition, CONDITIONS, "condition")
    except BadInput as error:
        # Of an unknown name without the list of all that are known.
        reason = str(error).partition(": ")[0] if str(error).startswith("unknown") else str(error)
        raise BadInput(
            f"{directory}: its run cannot be kept here: {reason}; install what is missing, {APART}"
        ) from error


def _with_kept(directory: Path, protocol: Protocol, kept: KeptRun) -> tuple[SceneObject, ...]:
    """Return the objects of both, as the dataset orders them."""
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
    """Yield the objects of the dataset, class by class, as far as both runs can have reached."""
    dataset = open_dataset(protocol.dataset)
    count = max(objects_to_search(manifest), len(protocol.objects))
    for class_name in protocol.suite.classes:
        if not dataset.classes or class_name in dataset.classes:
            yield from dataset.objects(class_name, None, count)


def _counted(count: int, kind: str) -> str:
    """Return a number and what it counts, as in "1 more method"; nothing for 0."""
    return f"{count} more {kind if count > 1 else kind.removesuffix('s')}" if count else ""
