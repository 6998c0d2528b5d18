"""The run that a folder holds, and whether a request belongs to it.

A folder holds one request. The same command goes on with the run, which can grow in two ways: by
more objects (a larger `--limit`) and by more methods (`bench add`). While a run grows, the manifest
and the tables of before stay until all objects of these tables are complete again. So they are as
they were when the run is stopped or killed before that.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from bench.catalogue.conditions import find_condition
from bench.catalogue.methods import Method, find_method, find_run_method, is_module_name
from bench.entered.claims import address_of
from bench.records.folder import check_directory
from bench.records.store import STORE, open_store
from bench.running.options import REPEATED, Options
from bench.running.protocol import (
    Protocol,
    find_objects,
    method_identity,
    name_of,
    objects_to_search,
)
from data_prep.datasets.objects import SceneObject
from data_prep.datasets.registry import open_dataset
from data_prep.failures import BadInput
from data_prep.progress import log

APART = "give --out for a run of its own, or --fresh to start over"
# The source of a method MODULE:NAME that is known from the manifest only, without its module.
NOT_LOADED = "of a module that this command does not name"


@dataclass(frozen=True)
class HeldRun:
    """The run that a folder holds before this one begins; empty where it holds none."""

    manifest: Mapping[str, Any] = field(default_factory=dict)
    tabled: frozenset[str] = frozenset()  # the objects ("class/name") in the tables of the folder
    is_emptied: bool = False  # whether there are tables, but no finished job in the store any more


def read_held(directory: Path, asked: Protocol) -> HeldRun:
    """Return the run that a folder holds.

    Raises BadInput for a folder of another suite, dataset, number of views, seed or device, and for
    one that holds something else than a run.
    """
    manifest = check_directory(directory, asked.fixed)
    if not manifest:
        return HeldRun()
    with open_store(directory) as store:
        if not manifest.get("finished") and not store.has_list:
            return HeldRun(manifest)  # the run was stopped before it had tables
        return HeldRun(manifest, frozenset(manifest["objects"]), store.is_empty)


def protocol_in_folder(asked: Protocol, held: HeldRun, options: Options) -> Protocol:
    """Return the protocol that a run has in its folder.

    It is the one that is asked for; `bench add` adds the methods and objects of the run in the
    folder. Lines on stderr say why finished jobs are done again. Raises BadInput where the folder
    holds another request, with what differs; for `bench add` where a method, a condition or an
    object of the run in the folder is not known here.
    """
    if not held.manifest:
        return asked
    if options.adds:
        protocol = _with_added(asked, held, options.directory)
    else:
        _refuse_other_names(asked, held, options.directory)
        _refuse_other_objects(asked, held, options.directory)
        protocol = asked
    if held.tabled:
        _tell_done_again(asked, held, options.directory)
    return protocol


def _tell_done_again(asked: Protocol, held: HeldRun, directory: Path) -> None:
    """Say on stderr why all finished jobs of the folder are done again, where they are."""
    was = {**held.manifest["environment"], **held.manifest["feature_identity"]}
    now = {**asked.environment, **asked.feature_identity}
    if changed := [name for name in {**was, **now} if was.get(name) != now.get(name)]:
        log(f"{directory}: was made with another {', '.join(changed)}; all its jobs are done again")
    if held.is_emptied:
        log(f"{directory}: {STORE} has none of its finished jobs any more; all are done again")


def stated_request(options: Options, protocol: Protocol, held: HeldRun) -> dict[str, Any]:
    """Return the options that repeat a run, with the values of those that were left to defaults."""
    if options.adds:
        limit = held.manifest["request"].get("limit")
    else:
        objects_by_class = Counter(obj.class_name for obj in protocol.objects)
        limit = max(objects_by_class.values())
    stated = {
        **options.request,
        "methods": [method.address for method in protocol.methods.values()],
        "conditions": list(protocol.conditions),
        "views": protocol.views,
        "seed": protocol.seed,
        "limit": limit,
    }
    return {name: stated[name] for name in REPEATED if stated.get(name) is not None}


def planned_objects(options: Options, protocol: Protocol, held: HeldRun) -> int:
    """Return how many objects the run is to have.

    `bench add` keeps the number of the run in the folder, which may have been stopped before it.
    """
    return held.manifest["planned"] if options.adds else len(protocol.objects)


def _refuse_other_names(asked: Protocol, held: HeldRun, directory: Path) -> None:
    """Raise BadInput for other methods or conditions than those of the run in the folder."""
    for kind, here in (("methods", asked.methods), ("conditions", asked.conditions)):
        names = held.manifest[kind]
        lacking = [name for name in names if name not in here]
        further = [name for name in here if name not in names]
        if not lacking and not further:
            continue
        differing = [f"without {', '.join(further)}"] if further else []
        differing += [f"with {', '.join(lacking)}"] if lacking else []
        remedy = f"name all with --{kind}, {APART}"
        if kind == "methods" and not lacking:
            remedy = f"'bench add {further[0]} {directory}' adds one, or {APART}"
        raise BadInput(
            f"{directory}: holds a run of other {kind}, {' and '.join(differing)}; {remedy}"
        )


def _refuse_other_objects(asked: Protocol, held: HeldRun, directory: Path) -> None:
    """Raise BadInput where an object of the run in the folder is not asked for."""
    planned, names = held.manifest["planned"], {*asked.names}
    lacking = [name for name in held.manifest["objects"] if name not in names]
    if len(names) < planned:
        raise BadInput(
            f"{directory}: holds a run of {planned} objects, not {len(names)}; give its --limit "
            f"again or a larger one, {APART}"
        )
    if lacking:
        raise BadInput(
            f"{directory}: the run there has {lacking[0]} ({len(lacking)} in all), which "
            f"{asked.dataset} no longer has, or not among its first {len(names)}; {APART}"
        )


def _with_added(asked: Protocol, held: HeldRun, directory: Path) -> Protocol:
    """Return the protocol of the run in a folder, to which the methods asked for are added."""
    kept = _methods_there(directory, asked, held.manifest)
    order = dict.fromkeys((*held.manifest["methods"], *asked.methods))
    methods = {**kept, **asked.methods}
    return replace(
        asked,
        methods={name: methods[name] for name in order},
        objects=_objects_there(directory, asked, held.manifest),
    )


def _objects_there(
    directory: Path, asked: Protocol, manifest: Mapping[str, Any]
) -> tuple[SceneObject, ...]:
    """Return the objects of the run in a folder, in the order of the dataset.

    Raises BadInput where the dataset has lost one of them.
    """
    wanted = {*manifest["objects"]}
    dataset = open_dataset(asked.dataset)
    objects = find_objects(asked.suite, dataset, wanted, objects_to_search(manifest))
    if lost := sorted(wanted - {*map(name_of, objects)}):
        raise BadInput(
            f"{directory}: the run there has {lost[0]} ({len(lost)} in all), which {asked.dataset} "
            f"no longer has; bring it back, {APART}"
        )
    return objects


def _methods_there(
    directory: Path, asked: Protocol, manifest: Mapping[str, Any]
) -> dict[str, Method]:
    """Return the methods of the run in a folder, except those that are asked for, by id.

    Of a method MODULE:NAME only the identity in the manifest is used: no code is executed because a
    manifest names it, and the method's finished jobs stay. Raises BadInput for other methods and
    conditions that are not known here, and for weights that cannot be used.
    """
    methods: dict[str, Method] = {}
    try:
        for name in manifest["methods"]:
            if name in asked.methods:
                continue
            if is_module_name(name) and name in manifest["identities"]:
                methods[name] = _known_by_identity(name, manifest["identities"][name])
                continue
            methods[name] = find_run_method(address_of(manifest, name))
            method_identity(methods[name], asked.device)  # refuses weights that cannot be used
        for condition in manifest["conditions"]:
            find_condition(condition)
    except BadInput as error:
        # An unknown name is refused with a list of all known names, which would hide the remedy.
        reason = str(error).partition(": ")[0] if str(error).startswith("unknown") else str(error)
        raise BadInput(
            f"{directory}: its run cannot be continued on this machine: {reason}; install what is "
            f"missing, {APART}"
        ) from error
    return methods


def _known_by_identity(name: str, identity: Sequence[Any]) -> Method:
    """Return a method MODULE:NAME as its entry in a manifest describes it, without its module."""
    version, text, _ = identity
    return Method(
        name,
        # No job of this method is drawn; if one were, `find_method` would refuse the name.
        load=lambda device: find_method(name).load(device),
        identity=lambda: str(text),
        version=int(version),
        source=NOT_LOADED,
    )
