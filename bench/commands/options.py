"""The options of commands, each stated once; a dataclass's fields become options of a command."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass, fields
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from data_prep.failures import BadInput

RunDirectory = Annotated[Path, typer.Argument(metavar="DIR", help="The folder of a finished run.")]


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


WorkersOption = Annotated[int | None, typer.Option(help="Worker processes; default: all cores.")]
DeviceOption = Annotated[Device, typer.Option(help="Where networks run.")]


@dataclass(frozen=True)
class Stated:
    """An option: its annotation, and what makes the value of a field from what was given.

    default  where the field of the dataclass has none
    """

    annotation: Any
    convert: Callable[[Any], Any] = lambda value: value
    default: Any = inspect.Parameter.empty


def takes(
    kind: type[Any], stated: Mapping[str, Stated], leave_out: tuple[str, ...] = ()
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a command an option for each field of the dataclass `kind`, in the order of `stated`.

    The command gets the dataclass as its first argument; options of its own come after it. Defaults
    are those of the dataclass.
    """
    of_kind = {field.name: field for field in fields(kind)}
    taken = {name: option for name, option in stated.items() if name not in leave_out}

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        own = list(inspect.signature(command, eval_str=True).parameters.values())[1:]

        @functools.wraps(command)
        def parsed(**values: Any) -> None:
            of_options = {name: option.convert(values.pop(name)) for name, option in taken.items()}
            command(kind(**of_options), **values)

        parameters = [
            *(_parameter(of_kind[name], option) for name, option in taken.items()),
            *(one.replace(kind=inspect.Parameter.KEYWORD_ONLY) for one in own),
        ]
        parsed.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        parsed.__annotations__ = {one.name: one.annotation for one in parameters}
        return parsed

    return decorate


def _parameter(field: Any, option: Stated) -> inspect.Parameter:
    default = option.default
    if default is inspect.Parameter.empty and field.default is not MISSING:
        default = field.default
    return inspect.Parameter(
        field.name,
        inspect.Parameter.KEYWORD_ONLY,
        default=default,
        annotation=option.annotation,
    )


def _shard(text: str | None) -> Any:
    from bench.running.protocol import read_shard

    return read_shard(text) if text else None


RUN_OPTIONS = {  # of `bench.running.protocol.Options`, as `bench run` and `bench plan` have them
    "suite": Stated(Annotated[str, typer.Option(help="The suite, see 'bench list'.")]),
    "dataset": Stated(
        Annotated[
            str,
            typer.Option(
                help="procedural, folder:PATH (sub-folders are classes), shapenet:PATH, "
                "modelnet:PATH or paper:PATH; see 'bench data inspect PATH'."
            ),
        ]
    ),
    "methods": Stated(
        Annotated[str | None, typer.Option(help="Comma-separated; blank is always measured.")],
        names,
    ),
    "conditions": Stated(Annotated[str | None, typer.Option(help="Comma-separated.")], names),
    "limit": Stated(Annotated[int | None, typer.Option(help="At most so many objects a class.")]),
    "views": Stated(Annotated[int | None, typer.Option(help="Views per object.")]),
    "workers": Stated(
        Annotated[
            int | None, typer.Option(help="Worker processes, one thread each; default: all cores.")
        ],
        worker_count,
    ),
    "device": Stated(DeviceOption, str, Device.auto),
    "seed": Stated(Annotated[int, typer.Option(help="Seed of clouds, views and noise.")]),
    "out": Stated(
        Annotated[
            Path | None,
            typer.Option(help="The run's folder; default: results/runs/SUITE-DATASET."),
        ]
    ),
    "shard": Stated(
        Annotated[
            str | None,
            typer.Option(metavar="k/N", help="Only the kth of N parts; 'bench merge' joins them."),
        ],
        _shard,
    ),
    "ray": Stated(
        Annotated[
            str | None,
            typer.Option(
                metavar="ADDRESS|local",
                help="On a Ray cluster: host:port, auto; see docs/cluster.md.",
            ),
        ]
    ),
    "fresh": Stated(
        Annotated[
            bool, typer.Option("--fresh", help="Start over; an old run is renamed, not deleted.")
        ]
    ),
    "inception_weights": Stated(
        Annotated[
            str | None,
            typer.Option(
                metavar="PATH|download",
                help="Weights for fid: a file, or 'download' (95 MB, once). Default: as "
                "downloaded before, else fid is skipped.",
            ),
        ]
    ),
}
