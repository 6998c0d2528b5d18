"""The options of commands, each stated once; a dataclass's fields become options of a command."""

from __future__ import annotations

import functools
import inspect
import sys
from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass, fields
from enum import Enum, StrEnum
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

import typer
from typer.core import TyperGroup

from data_prep.failures import BadInput, unknown

# Click's, which some Typers contain.
USAGE_ERROR: Any = typer.BadParameter.__mro__[1]
SETTINGS: dict[str, Any] = {"add_completion": False, "rich_markup_mode": None}
RunDirectory = Annotated[Path, typer.Argument(metavar="DIR", help="The folder of a finished run.")]


class Group(TyperGroup):
    """A group of commands. Without arguments it shows its help and ends with status 2."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:  # click's Context
        """Return what stands before the command, and the command."""
        if not args:
            print(ctx.get_help(), file=sys.stderr)
            raise typer.Exit(2)
        return super().parse_args(ctx, args)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return the command and its arguments. Raises BadInput for an unknown one."""
        if self.get_command(ctx, args[0]) is None:
            see = f"{ctx.command_path} --help"
            raise unknown(args[0], self.list_commands(ctx), "command", see=see)
        return super().resolve_command(ctx, args)


class Device(StrEnum):
    """Where networks run."""

    auto = "auto"
    cpu = "cpu"
    cuda = "cuda"


def names(text: str | None) -> tuple[str, ...] | None:
    """The names in a comma-separated list; None for None. Raises BadInput for an empty list."""
    if text is None:
        return None
    found = tuple(name.strip() for name in text.split(",") if name.strip())
    if not found:
        raise BadInput(f"'{text}': expected names separated by commas")
    return found


def worker_count(workers: int | None) -> int | None:
    """The option --workers. Raises BadInput below 1."""
    if workers is not None and workers < 1:
        raise BadInput(f"--workers {workers}: must be at least 1")
    return workers


def expanded(path: Path) -> Path:
    """Return a path with the home folder in place of ~, which a shell leaves in `--out=~/x`.

    Raises BadInput for the home of an unknown user.
    """
    try:
        return path.expanduser()
    except RuntimeError as error:
        raise BadInput(f"{path}: no such user; give the folder's path") from error


class Format(StrEnum):
    """How full tables are printed."""

    md = "md"
    csv = "csv"
    json = "json"


FormatOption = Annotated[
    Format | None,
    typer.Option(
        "--format",
        help="Print all tables, for people (md) or for scripts (csv, json). Default: the headline "
        "table alone.",
    ),
]
DEVICE = "Where networks run; auto: on a GPU if there is one."
WorkersOption = Annotated[
    int | None, typer.Option(help="Worker processes. Default: one for each core.")
]
DeviceOption = Annotated[Device, typer.Option(help=DEVICE)]


@dataclass(frozen=True)
class OptionSpec:
    """What an option has that the field of the dataclass does not say.

    flag     where the option has another name than the field
    kind     the type of what is given, where it is not that of the field
    convert  makes the value of the field from what is given
    default  of what is given, where it is not that of the field
    """

    help: str | None = None
    flag: str | None = None
    metavar: str | None = None
    kind: Any = None
    convert: Callable[[Any], Any] | None = None
    default: Any = inspect.Parameter.empty


def options_from_dataclass(
    kind: type[Any], stated: Mapping[str, str | OptionSpec], leave_out: tuple[str, ...] = ()
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a command an option for each field of the dataclass `kind`, in the order of `stated`.

    stated  the help of each, or more than that

    The command gets the dataclass as its first argument; options of its own come after it. Types
    and defaults are those of the dataclass; a tuple of names is given as comma-separated text.
    """
    hints, of_kind = get_type_hints(kind), {field.name: field for field in fields(kind)}
    taken = {
        name: _option(name, hints[name], of_kind[name].default, option)
        for name, option in stated.items()
        if name not in leave_out
    }

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        own = list(inspect.signature(command, eval_str=True).parameters.values())[1:]

        @functools.wraps(command)
        def parsed(**values: Any) -> None:
            converted = {name: convert(values.pop(name)) for name, (_, convert) in taken.items()}
            command(kind(**converted), **values)

        parameters = [
            *(parameter for parameter, _ in taken.values()),
            *(one.replace(kind=inspect.Parameter.KEYWORD_ONLY) for one in own),
        ]
        parsed.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        parsed.__annotations__ = {one.name: one.annotation for one in parameters}
        return parsed

    return decorate


def _option(
    name: str, hint: Any, default: Any, option: str | OptionSpec
) -> tuple[inspect.Parameter, Callable[[Any], Any]]:
    """The parameter of a command, and what makes a field's value from what it is given."""
    option = option if isinstance(option, OptionSpec) else OptionSpec(option)
    kind = option.kind or hint
    convert = option.convert or (lambda value: value)
    if option.default is not inspect.Parameter.empty:
        default = option.default
    elif default is MISSING:
        default = inspect.Parameter.empty
    parts = get_args(kind) if isinstance(kind, UnionType) else (kind,)
    if any(get_origin(part) is tuple for part in parts):
        kind, convert = str | None, option.convert or names
    elif get_origin(kind) is Literal:
        kind = StrEnum(name.capitalize(), {value: value for value in get_args(kind)})
    if isinstance(kind, type) and issubclass(kind, Enum):
        default, convert = kind(default), str
    flags = [option.flag] if option.flag else []
    if kind is bool and not default and not flags:
        flags = [f"--{name.replace('_', '-')}"]  # there is nothing to switch off
    return (
        inspect.Parameter(
            name,
            inspect.Parameter.KEYWORD_ONLY,
            default=default,
            annotation=Annotated[
                kind, typer.Option(*flags, help=option.help, metavar=option.metavar)
            ],
        ),
        convert,
    )


def _shard(text: str | None) -> Any:
    from bench.running.shards import read_shard

    return read_shard(text) if text else None


def _budget(text: str | None) -> float | None:
    from bench.running.schedule import seconds_of

    return None if text is None else seconds_of(text)


RUN_OPTIONS: dict[str, str | OptionSpec] = {  # of `bench.running.protocol.Options`
    "suite": "The suite, see 'bench list'.",
    "dataset": "Dataset: procedural, folder:PATH (sub-folders are classes), shapenet:PATH, "
    "modelnet:PATH, paper:PATH or exported:PATH; see 'bench data inspect PATH'.",
    "methods": "Methods, comma-separated; blank is always measured. Default: the suite's.",
    "conditions": "Conditions, comma-separated. Default: the suite's.",
    "limit": "Objects of each class at most. Default: all of a folder; of procedural shapes the "
    "suite's number.",
    "budget": OptionSpec(
        "Time for the whole run: objects that would not be done in time are left for later, when "
        "the same command goes on. Default: no limit.",
        metavar="90s|2m|1.5h",
        kind=str | None,
        convert=_budget,
    ),
    "views": "Images of each object. Default: the suite's number.",
    "workers": OptionSpec(
        "Worker processes, one thread each. Default: one for each core; one where a suite compares "
        "times.",
        convert=worker_count,
    ),
    "device": OptionSpec(DEVICE, kind=Device),
    "seed": "Seed of clouds, views and noise. Default: 0, or that of an export.",
    "out": OptionSpec(
        "The run's folder. Default: results/runs/SUITE-DATASET.",
        convert=lambda path: path and expanded(path),
    ),
    "shard": OptionSpec(
        "Only the kth of N parts of the objects; 'bench merge' joins them. Default: all objects.",
        metavar="k/N",
        kind=str | None,
        convert=_shard,
    ),
    "ray": OptionSpec(
        "Run on a Ray cluster: host:port, auto or local; see docs/cluster.md. Default: on this "
        "machine.",
        metavar="ADDRESS|local",
    ),
    "fresh": OptionSpec(
        "Start again; a run that is in the folder is renamed, not deleted. Default: go on with it.",
        flag="--fresh/--no-fresh",  # a file may switch it on
    ),
    "inception_weights": OptionSpec(
        "Weights for fid: a file, or 'download' (95 MB, once). Default: as downloaded before, else "
        "fid is skipped.",
        metavar="PATH|download",
    ),
}
