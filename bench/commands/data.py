"""`bench data`: inspect a dataset, check the files of an export, and export a run's inputs."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import Annotated

import typer

from bench.check.inspection import inspect, verify
from bench.commands.options import (
    RUN_OPTIONS,
    SETTINGS,
    Group,
    OptionSpec,
    WorkersOption,
    options_from_dataclass,
    path_argument,
    path_option,
    worker_count,
)
from bench.running.environment import cores
from bench.running.export import export
from bench.running.options import Options
from bench.tables.markdown import visible

app = typer.Typer(cls=Group, help="Inspect, verify and export datasets.", **SETTINGS)


@app.command("inspect")
def _inspect_data(
    location: Annotated[
        str,
        typer.Argument(
            metavar="PATH",
            help="A folder, or a dataset as 'bench run' takes it, such as shapenet:PATH.",
        ),
    ],
    sample: Annotated[int, typer.Option(help="Objects read of each class.")] = 10,
    workers: WorkersOption = None,
) -> None:
    """Print the classes, splits and problems of a dataset. Exit 1 if there is a problem."""
    inspection = inspect(location, sample, worker_count(workers) or cores())
    for line in inspection.lines:
        print(visible(line))
    for line in inspection.irregular:
        print(f"IRREGULAR    {visible(line)}")
    dataset = f"--dataset {shlex.quote(inspection.spec)}"
    print(f"use          {'bench render FILE' if inspection.clouds else dataset}")
    if inspection.irregular:
        raise typer.Exit(1)


@app.command("verify")
def _verify_data(
    folder: Annotated[Path, path_argument("FOLDER", "The folder of an export.")],
) -> None:
    """Check that an export is whole. Exit 1 if not."""
    same, differing = verify(folder)
    print(f"{same} files are those of the list")
    for kind, name in differing:
        print(f"{kind:<8} {visible(name)}")
    if differing:
        raise typer.Exit(1)


_EXPORT_OPTIONS: dict[str, str | OptionSpec] = {
    "suite": OptionSpec("The suite whose objects and views these are.", default="chair-robustness"),
    "dataset": RUN_OPTIONS["dataset"],
    "truth": RUN_OPTIONS["truth"],
    "conditions": "Conditions, comma-separated, or 'all' for those that 'bench list' has of this "
    "project. Default: the suite's.",
    **{name: RUN_OPTIONS[name] for name in ("limit", "views", "workers", "seed")},
}


@app.command("export")
@options_from_dataclass(Options, _EXPORT_OPTIONS)
def _export_data(options: Options, out: Annotated[Path, path_option("The new folder.")]) -> None:
    """Write the clouds, views and true images of a run as files with checksums."""
    print(f"{export(options, out)} objects written to {out}", file=sys.stderr)
    print(f"use          --dataset {shlex.quote(f'exported:{out}')}")
