"""The option --config: the options in the manifest of a run become those of the command."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from bench.catalogue.suites import SUITES
from bench.commands.options import USAGE_ERROR, plain_message, read_path
from bench.entered.claims import address_of
from bench.records.folder import load_manifest
from bench.records.job import SCHEMA_VERSION
from bench.running.options import REPEATED, Options
from bench.running.protocol import name_of, objects_of
from data_prep.datasets.registry import open_dataset
from data_prep.failures import BadInput

_REQUEST = "request"  # the key in a manifest that holds the options of the command
_INSTEAD = "give the manifest.json of another run"  # the remedy for a manifest that cannot be used
# The options that decide what a run measures. The device only decides where it is measured.
MEASURED = {*REPEATED} - {"device"}
JOB_SUITES = {suite.id: suite for suite in SUITES}  # the suites whose runs consist of jobs


def read_config(path: Path) -> dict[str, Any]:
    """Return the options in a manifest, by their names with underscores.

    A list becomes text separated by commas, as on the command line. Raises BadInput for a file that
    cannot be read, or is no manifest that this version can repeat.
    """
    options = {}
    for name, value in repeated_request(path).items():
        options[name] = ",".join(map(str, value)) if isinstance(value, list) else value
    return options


def refuse_other_objects(options: Options, path: Path | None) -> None:
    """Raise BadInput where the run in a manifest is to be repeated and would have other objects.

    Options choose the first objects of each class. The objects that a stopped run has completed may
    be others, and the dataset may have changed since. Nothing is refused where the command line
    asks for another suite, dataset or limit than the manifest: then other objects are wanted.
    """
    if path is None or options.suite not in JOB_SUITES:
        return
    manifest, repeated = _manifest(path), read_config(path)
    for name in ("suite", "dataset", "limit"):
        if getattr(options, name) != repeated.get(name):
            return
    suite = JOB_SUITES[options.suite]
    names = [name_of(obj) for obj in objects_of(suite, open_dataset(options.dataset), options)]
    if names != manifest["objects"]:
        raise BadInput(
            f"{path}: the {len(manifest['objects'])} objects of that run are not the "
            f"{len(names)} that options can choose now; finish it with its command, bring its "
            "dataset back as it was, or give another --limit"
        )


def _manifest(path: Path) -> Mapping[str, Any]:
    """Return the manifest of a run of this version that can be repeated."""
    manifest = load_manifest(path, remedy=_INSTEAD)
    if not manifest.get(_REQUEST):
        raise BadInput(
            f"{path}: holds no options of a run; give the manifest.json of a run of this version"
        )
    return manifest


def repeated_request(path: Path) -> Mapping[str, Any]:
    """Return the request in a manifest, with the methods, conditions and views it has measured.

    Options that do not decide what is measured, such as a folder or a number of workers, are left
    out: a manifest may come from a stranger, who must not choose them. Raises
    BadInput for a file that is no manifest, and for a run of another version of the protocol or of
    the schema.
    """
    manifest = _manifest(path)
    if (schema := manifest["schema_version"]) != SCHEMA_VERSION:
        raise BadInput(
            f"{path}: has schema {schema}, and this version has {SCHEMA_VERSION} and would measure "
            f"something else; use the version that made it, or {_INSTEAD}"
        )
    repeated = {name: value for name, value in manifest[_REQUEST].items() if name in MEASURED}
    if manifest["suite"] not in JOB_SUITES:
        return repeated
    repeated["conditions"] = manifest["conditions"]
    repeated["views"] = manifest["views"]
    repeated["methods"] = [address_of(manifest, method) for method in manifest["methods"]]
    objects_of_class = Counter(name.partition("/")[0] for name in manifest["objects"])
    if objects_of_class:
        repeated["limit"] = max(objects_of_class.values())
    return repeated


def _take(context: typer.Context, path: Path | None) -> Path | None:
    """Make the options in the manifest the defaults of the command; return its path.

    Raises BadInput for a value that an option does not take.
    """
    if path is None:
        return None
    values = read_config(path)
    for option in context.command.params:
        if option.name in values:
            _check(path, context, option, values[option.name])
    context.default_map = {**(context.default_map or {}), **values}
    return path


def _check(path: Path, context: typer.Context, option: Any, value: Any) -> None:
    """Raise BadInput for a value that an option does not take."""
    try:
        option.process_value(context, value)
    except USAGE_ERROR as error:
        raise BadInput(
            f"{path}: {option.name} = {value!r}: {plain_message(error.message)}; {_INSTEAD}"
        ) from error


ConfigOption = Annotated[
    Path | None,
    typer.Option(
        "--config",
        metavar="FILE",
        is_eager=True,  # read before all other options, whose defaults it sets
        callback=_take,
        parser=read_path,
        help="The manifest.json of a run, to repeat it. Options of the command line replace those "
        "of the file. Default: none.",
    ),
]
