"""Options of a command in a file: TOML, or the manifest of a run, which repeats it."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from data_prep.failures import BadInput, unknown
from data_prep.untrusted import MIB, read_text

REQUEST = "request"  # of a manifest: what the command said


def read_config(path: Path) -> dict[str, Any]:
    """The options in a file, by their names with underscores.

    A list is what the command line separates by commas. Raises BadInput for a file that cannot be
    read, is not TOML, or is a JSON file that is no manifest of a run.
    """
    text = read_text(path, 4 * MIB)
    try:
        found = json.loads(text).get(REQUEST) if path.suffix == ".json" else tomllib.loads(text)
    except (ValueError, AttributeError) as error:  # both decoders raise subclasses of ValueError
        raise BadInput(f"{path}: cannot be read ({error}); give a TOML file") from error
    if not isinstance(found, Mapping):
        raise BadInput(
            f"{path}: says not what was asked for; give the manifest.json of a run of this version"
        )
    return {name.replace("-", "_"): _as_given(value) for name, value in found.items()}


def _as_given(value: Any) -> Any:
    """As the command line would have it."""
    return ",".join(map(str, value)) if isinstance(value, list) else value


def _take(context: typer.Context, path: Path | None) -> Path | None:
    """Make the options of the file the defaults of the command; BadInput for an unknown one."""
    if path is None:
        return None
    found = read_config(path)
    known = sorted({str(one.name) for one in context.command.params} - {"config", "help"})
    for name in found:
        if name not in known:
            see = f"{context.command_path} --help"
            raise BadInput(f"{path}: {unknown(name, known, 'option', see=see)}")
    context.default_map = {**(context.default_map or {}), **found}
    return path


ConfigOption = Annotated[
    Path | None,
    typer.Option(
        "--config",
        metavar="FILE",
        is_eager=True,  # the others have their defaults from it
        callback=_take,
        help="Options in a TOML file, or the manifest.json of a run, to repeat it. Options of the "
        "command line come first. Default: none.",
    ),
]
