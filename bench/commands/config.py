"""The options of a command in a file: TOML, or the manifest of a run to repeat."""

from __future__ import annotations

import tomllib
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from bench.catalogue.images import address_of
from bench.catalogue.lookup import instead_of, unknown
from bench.catalogue.suites import SUITES
from bench.commands.options import USAGE_ERROR, plain_message, read_path
from bench.records.record import SCHEMA_VERSION
from bench.records.run_folder import load_manifest
from bench.running.options import REPEATED, Options
from bench.running.protocol import name_of, objects_of
from data_prep.datasets.registry import open_dataset
from data_prep.failures import BadInput
from data_prep.files.safe_read import MIB, read_text

_REQUEST = "request"  # key in a manifest: the options of the command
_INSTEAD = "give the manifest.json of a run, or state the options in a TOML file"
MEASURED = {*REPEATED} - {"device"}  # where it was measured is no part of what
JOB_SUITES = {suite.id: suite for suite in SUITES}


def read_config(path: Path) -> dict[str, Any]:
    """Return the options in a file, by their names with underscores.

    A list becomes text separated by commas, as on the command line. Raises BadInput for a file that
    cannot be read, is not TOML, or is a JSON file but no manifest that this version can repeat.
    """
    if path.suffix == ".json":
        values = repeated_request(path)
    else:
        try:
            values = tomllib.loads(read_text(path, 4 * MIB))
        except BadInput:
            raise
        except ValueError as error:
            raise BadInput(f"{path}: cannot be read ({error}); give a TOML file") from error
    return {
        name.replace("-", "_"): ",".join(map(str, value)) if isinstance(value, list) else value
        for name, value in values.items()
    }


def refuse_other_objects(options: Options, path: Path | None) -> None:
    """Raise BadInput where a run is to be repeated and would have other objects.

    Options choose the first objects of each class; the complete objects of a stopped
    run may be others, and the dataset may have changed. Other options of the command line pass.
    """
    if path is None or path.suffix != ".json" or options.suite not in JOB_SUITES:
        return
    manifest, repeated = _manifest(path), read_config(path)
    if (options.suite, options.dataset, options.limit) != (
        *(repeated.get(name) for name in ("suite", "dataset", "limit")),
    ):
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
            f"{path}: has no options of a run; give the manifest.json of a run of this version"
        )
    return manifest


def repeated_request(path: Path) -> Mapping[str, Any]:
    """Return the request in a manifest, with the methods, conditions and views it has measured.

    What does not say what is measured is left out: a manifest may come from anywhere. Raises
    BadInput for a file that is no manifest, and for a run of another version of the protocol or of
    the schema.
    """
    manifest = _manifest(path)
    if (schema := manifest["schema_version"]) != SCHEMA_VERSION:
        raise BadInput(
            f"{path}: of schema {schema}, this version has {SCHEMA_VERSION} and would measure "
            f"something else; use the version that made it, or {_INSTEAD}"
        )
    request = {name: value for name, value in manifest[_REQUEST].items() if name in MEASURED}
    if manifest["suite"] not in JOB_SUITES:
        return request
    repeated = request | {name: manifest[name] for name in ("conditions", "views")}
    repeated["methods"] = [address_of(manifest, method) for method in manifest["methods"]]
    classes = Counter(name.partition("/")[0] for name in manifest["objects"])
    return repeated | ({"limit": max(classes.values())} if classes else {})


def _take(context: typer.Context, path: Path | None) -> Path | None:
    """Make the options of the file the defaults of the command; return its path.

    Raises BadInput for an unknown option, and for a value that it does not take.
    """
    if path is None:
        return None
    known = {
        flag.lstrip("-").replace("-", "_"): option
        for option in context.command.params
        for flag in option.opts
        if option.name not in ("config", "help")
    }
    defaults = dict(context.default_map or {})
    for name, value in read_config(path).items():
        if name not in known:
            command = context.command_path
            option = f"{command.removeprefix('bench ')} --{name.replace('_', '-')}"
            refusal = instead_of("option", option) or unknown(
                name, sorted(known), "option", see=f"{command} --help"
            )
            raise BadInput(f"{path}: {refusal}")
        option = known[name]
        _check(path, context, name, option, value)
        defaults[option.name] = value
    context.default_map = defaults
    return path


def _check(path: Path, context: typer.Context, name: str, option: Any, value: Any) -> None:
    """Raise BadInput for a value that an option does not take."""
    # The command line converts any kind of value from text: it would take true and 1.5 for 1.
    where = f"{path}: {name} = {value!r}"
    if isinstance(value, bool) != option.is_flag or not isinstance(value, bool | int | str):
        kinds = "true or false" if option.is_flag else "text, a whole number or a list of names"
        raise BadInput(f"{where}: give {kinds}")
    try:
        option.process_value(context, value)
    except USAGE_ERROR as error:
        raise BadInput(f"{where}: {plain_message(error.message)}") from error


ConfigOption = Annotated[
    Path | None,
    typer.Option(
        "--config",
        metavar="FILE",
        is_eager=True,  # the others have their defaults from it
        callback=_take,
        parser=read_path,
        help="Options in a TOML file, or the manifest.json of a run, to repeat it. Options of the "
        "command line replace those of the file. Default: none.",
    ),
]
