"""The options that commands share, and options made from the fields of a dataclass."""

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

# The error of click for a wrong command line. It is taken from typer, as some versions of typer
# contain a copy of click, whose error is another class than that of the package click.
USAGE_ERROR: Any = typer.BadParameter.__mro__[1]
SETTINGS: dict[str, Any] = {"add_completion": False, "rich_markup_mode": None}
_MOST_WORKERS = (
    1_024  # processes; more than any machine has cores, so that a larger number is a typo
)


def plain_message(text: str) -> str:
    """Return the message of a usage error without pydantic's words, which some Typers pass on."""
    return text.rstrip(".").replace("Value error, ", "")


def read_path(text: str | Path) -> Path:
    """Return a path of the command line with the home folder in place of ~.

    All options and arguments that are paths use this parser: a shell does not replace the ~ in
    `--out=~/x`, and a path in a manifest may begin with it, too. Raises typer.BadParameter for the
    home of an unknown user.
    """
    try:
        return Path(text).expanduser()
    except RuntimeError as error:
        raise typer.BadParameter(f"{text}: no such user; give the whole path") from error


def path_argument(metavar: str, help: str) -> Any:
    """Return the typer settings of an argument that takes one or several paths."""
    return typer.Argument(metavar=metavar, help=help, parser=read_path)


def path_option(help: str, *flags: str) -> Any:
    """Return the typer settings of an option that takes a path."""
    return typer.Option(*flags, help=help, parser=read_path)


RunDirectory = Annotated[Path, path_argument("DIR", "The folder of a finished run.")]


class Group(TyperGroup):
    """A group of commands. Without arguments it shows its help and ends with status 2."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:  # click's Context
        """Return the arguments after the options of the group; without any, print the help."""
        if not args:
            print(ctx.get_help(), file=sys.stderr)
            raise typer.Exit(2)
        return super().parse_args(ctx, args)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return the command and its arguments. Raises BadInput for an unknown command."""
        if self.get_command(ctx, args[0]) is None:
            see = f"{ctx.command_path} --help"
            raise unknown(args[0], self.list_commands(ctx), "command", see=see)
        return super().resolve_command(ctx, args)


class _TruthChoice(StrEnum):
    """The truth that images are scored against."""

    coloured = "coloured"
    grey = "grey"
    coloured_clouds = "coloured-clouds"


class Device(StrEnum):
    """The device on which networks run."""

    auto = "auto"
    cpu = "cpu"
    cuda = "cuda"


def names(text: str | None) -> tuple[str, ...] | None:
    """Return the names in a comma-separated list, each once; None for None.

    Raises BadInput for an empty list.
    """
    if text is None:
        return None
    # Each name is kept once: a metric that is asked for twice would count as two tests where
    # p values are corrected for the number of tests.
    parts = tuple(dict.fromkeys(name.strip() for name in text.split(",") if name.strip()))
    if not parts:
        raise BadInput(f"'{text}': expected names separated by commas")
    return parts


def worker_count(workers: int | None) -> int | None:
    """Return the value of --workers. Raises BadInput below 1 and above `_MOST_WORKERS`."""
    if workers is not None and workers < 1:
        raise BadInput(f"--workers {workers}: must be at least 1")
    if workers is not None and workers > _MOST_WORKERS:
        raise BadInput(f"--workers {workers}: too many processes; give at most {_MOST_WORKERS}")
    return workers


class Format(StrEnum):
    """The formats in which all tables of a run are printed."""

    md = "md"
    csv = "csv"
    json = "json"
    latex = "latex"


FormatOption = Annotated[
    Format | None,
    typer.Option(
        "--format",
        help="Print all tables, for people (md), scripts (csv, json) or papers (latex). Default: "
        "the headline table alone.",
    ),
]
# The help of --device, in all commands that have it.
DEVICE = "Where networks run; auto: on a GPU if there is one."
WorkersOption = Annotated[
    int | None, typer.Option(help="Worker processes. Default: one for each core.")
]


@dataclass(frozen=True)
class OptionSpec:
    """The facts about an option that the field of its dataclass does not tell.

    help     the help text
    flag     the names of the option, separated by spaces, where they differ from the field's name
    metavar  what stands for the value in the help
    kind     the type of the value on the command line, where it differs from the field's type
    convert  the function that returns the value of the field for a value of the command line
    default  the default on the command line, where it differs from the field's default
    """

    help: str | None = None
    flag: str | None = None
    metavar: str | None = None
    kind: Any = None
    convert: Callable[[Any], Any] | None = None
    default: Any = inspect.Parameter.empty


def options_from_dataclass(
    kind: type[Any], specs: Mapping[str, str | OptionSpec], leave_out: tuple[str, ...] = ()
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return a decorator that gives a command an option for each field of `kind` in `specs`.

    The command takes an instance of the dataclass as its first argument; its other parameters
    become options after those of the dataclass. Types and defaults come from the dataclass. A tuple
    of names is given as comma-separated text.

    specs      the help text or the `OptionSpec` of each option, by the name of its field, in the
               order in which the help lists them
    leave_out  fields in `specs` that get no option
    """
    hints, defaults = get_type_hints(kind), {field.name: field.default for field in fields(kind)}
    options = {
        name: _option(name, hints[name], defaults[name], spec)
        for name, spec in specs.items()
        if name not in leave_out
    }

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        @functools.wraps(command)
        def parsed(**values: Any) -> None:
            converted = {name: convert(values.pop(name)) for name, (_, convert) in options.items()}
            command(kind(**converted), **values)

        further = list(inspect.signature(command, eval_str=True).parameters.values())[1:]
        parameters = [
            *(parameter for parameter, _ in options.values()),
            *(parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY) for parameter in further),
        ]
        parsed.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        parsed.__annotations__ = {part.name: part.annotation for part in parameters}
        return parsed

    return decorate


def _option(
    name: str, hint: Any, default: Any, spec: str | OptionSpec
) -> tuple[inspect.Parameter, Callable[[Any], Any]]:
    """Return the parameter of a command, and the function from its value to the field's."""
    spec = spec if isinstance(spec, OptionSpec) else OptionSpec(spec)
    kind = spec.kind or hint
    convert = spec.convert or (lambda value: value)
    if spec.default is not inspect.Parameter.empty:
        default = spec.default
    elif default is MISSING:
        default = inspect.Parameter.empty
    parts = get_args(kind) if isinstance(kind, UnionType) else (kind,)
    if any(get_origin(part) is tuple for part in parts):
        kind, convert = str | None, spec.convert or names
    elif get_origin(kind) is Literal:
        kind = StrEnum(name.capitalize(), {value: value for value in get_args(kind)})
    if isinstance(kind, type) and issubclass(kind, Enum):
        default, convert = kind(default), str
    flags = spec.flag.split() if spec.flag else []
    if kind is bool and not default and not flags:
        # A single name, as typer would also add --no-NAME, which switches off what is off anyway.
        flags = [f"--{name.replace('_', '-')}"]
    annotation = typer.Option(
        *flags,
        help=spec.help,
        metavar=spec.metavar,
        parser=read_path if Path in parts else None,
    )
    keyword = inspect.Parameter.KEYWORD_ONLY
    parameter = inspect.Parameter(
        name, keyword, default=default, annotation=Annotated[kind, annotation]
    )
    return parameter, convert


def _seconds(text: str | None) -> float | None:
    from bench.running.plan import seconds_of

    return None if text is None else seconds_of(text)


def expand_file(text: str | None) -> str | None:
    """Return the name of a file with the home folder in place of ~, and any other text as it is."""
    return str(read_path(text)) if text and text.startswith("~") else text


# The options of `bench run`, by the fields of `bench.running.options.Options`.
RUN_OPTIONS: dict[str, str | OptionSpec] = {
    "suite": "The suite, see 'bench list'; own-meshes for a folder of your own.",
    "dataset": "Dataset: procedural, folder:PATH (sub-folders are classes), shapenet:PATH, "
    "modelnet:PATH, paper:PATH or exported:PATH; see 'bench data inspect PATH'.",
    "truth": OptionSpec(
        "The true images: in the colours of the objects; or with all faces in grey, where only the "
        "shape counts; or in colours that clouds have, too; see docs/protocol.md. Default: "
        "coloured, and grey for own-meshes.",
        kind=_TruthChoice | None,
        convert=lambda value: value and str(value),
    ),
    "methods": "Methods, comma-separated; blank is always measured. images:TREE names a method "
    "that was run elsewhere, by its images; see docs/extending.md. Default: the suite's.",
    "conditions": "Conditions, comma-separated. Default: the suite's.",
    "metrics": "Further metrics, comma-separated, which 'bench score' takes, too. Default: none.",
    "limit": "Objects of each class at most. Default: all of a folder; of procedural shapes the "
    "suite's number.",
    "budget": OptionSpec(
        "Time for the whole run: objects that would not be done in time are left for later: the "
        "same command goes on with them. Default: no limit.",
        metavar="90s|2m|1.5h",
        kind=str | None,
        convert=_seconds,
    ),
    "views": "Images of each object. Default: the suite's number.",
    "workers": OptionSpec(
        "Worker processes, one thread each. Default: one for each core; one where a suite compares "
        "times.",
        convert=worker_count,
    ),
    "device": OptionSpec(DEVICE, kind=Device),
    "seed": "Seed of clouds, views and noise. Default: 0, or that of an export.",
    "out": "The run's folder. Default: results/runs/SUITE-DATASET.",
    "ray": OptionSpec(
        "Run on a Ray cluster: host:port, auto or local; see docs/cluster.md. Default: on this "
        "machine.",
        metavar="ADDRESS|local",
    ),
    "fresh": OptionSpec(
        "Start again; a run that is in the folder is renamed, not deleted. Default: go on with it."
    ),
    "inception_weights": OptionSpec(
        "Weights for fid: a file, or 'download' (95 MB, once). Default: as downloaded before, else "
        "fid is skipped.",
        metavar="PATH|download",
        convert=expand_file,
    ),
}
