"""`bench data`: inspect a dataset, check the files of an export, and export a run's inputs."""

from __future__ import annotations

import json
import shlex
import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from bench.check.inspection import Inspection, inspect, verify
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
from data_prep.failures import BadInput

_SAMPLE = 10  # objects read of each class, which take seconds


class _Format(StrEnum):
    """The formats of a report on a dataset."""

    text = "text"
    json = "json"


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
    sample: Annotated[
        int | None, typer.Option(help="Objects read of each class. Default: 10.")
    ] = None,
    all: Annotated[
        bool, typer.Option("--all", help="Read all objects of all splits, list every problem.")
    ] = False,
    workers: WorkersOption = None,
    format: Annotated[
        _Format, typer.Option(help="Format of the report; json lists every problem that is found.")
    ] = _Format.text,
) -> None:
    """Print the classes, splits and problems of a dataset. Exit 1 if there is a problem."""
    if all and sample is not None:
        raise BadInput(f"--sample {sample}: --all reads every object; leave out one of them")
    wanted = None if all else _SAMPLE if sample is None else sample
    inspection = inspect(location, wanted, worker_count(workers) or cores())
    if format is _Format.json:
        print(_as_json(inspection))
    else:
        _print_inspection(inspection, all)
    if inspection.irregular or inspection.problems:
        raise typer.Exit(1)


def _print_inspection(inspection: Inspection, every_problem: bool) -> None:
    """Print the facts, the problems on demand, the lines on what is irregular, and what to use."""
    dataset = inspection.dataset
    facts = [("layout", dataset.layout), ("orientation", dataset.orientation)]
    facts += _counts(inspection)
    if dataset.left_out:
        facts.append(("left out", dataset.left_out))
    if checksum := inspection.checksum:
        facts.append(("checksum", f"{checksum.sha256} of {checksum.files} files"))
    facts.append(("read", f"{inspection.read} objects"))
    if inspection.angles:
        facts.append(("angles", inspection.angles))
    if inspection.clouds:
        facts.append(("clouds", "points without faces: they can be drawn, not scored"))
    if every_problem:
        facts += [("PROBLEM", f"{p.object}: {p.kind}: {p.reason}") for p in inspection.problems]
    facts += [("IRREGULAR", line) for line in (*inspection.irregular, *inspection.kinds)]
    untold = not inspection.whole or len(inspection.problems) > len(inspection.kinds)
    if inspection.kinds and untold and not every_problem and dataset.finite is not None:
        facts.append(("more", "--all reads every object and lists every problem"))
    use = f"--dataset {shlex.quote(inspection.spec)}"
    facts.append(("use", "bench render FILE" if inspection.clouds else use))
    for name, text in facts:
        print(visible(f"{name:<12} {text}"))


def _counts(inspection: Inspection) -> list[tuple[str, str]]:
    """Return a line with the number of objects of each class, by split."""
    dataset = inspection.dataset
    if dataset.finite is None:
        return [("classes", f"{', '.join(dataset.classes)}: as many objects as one asks for")]
    if not dataset.classes:
        return [("classes", f"none: {len(dataset.finite)} objects for any class")]
    lines = [
        ("class", f"{name}: " + ", ".join(f"{split} {count}" for split, count in counts.items()))
        for name, counts in inspection.counts.items()
    ]
    if not dataset.splits:
        lines.append(("splits", "none: all objects are taken"))
    return lines


def _as_json(inspection: Inspection) -> str:
    """Return a report as JSON; what a dataset of its kind does not have is null."""
    dataset, checksum = inspection.dataset, inspection.checksum
    report = {
        "dataset": inspection.spec,
        "regular": not (inspection.irregular or inspection.problems),
        "layout": dataset.layout,
        "orientation": dataset.orientation,
        "classes": dataset.classes,
        "counts": inspection.counts or None,
        "left_out": dataset.left_out or None,
        "checksum": checksum._asdict() if checksum else None,
        "read": inspection.read,
        "angles": inspection.angles or None,
        "clouds": inspection.clouds,
        "irregular": inspection.irregular,
        "problems": [
            {"object": problem.object, "kind": problem.kind, "reason": problem.reason}
            for problem in inspection.problems
        ],
    }
    text = json.dumps(report, indent=1, ensure_ascii=False)
    # A glTF may name a file by half of a surrogate pair, which UTF-8 cannot hold. What stands for
    # it here is its escape in JSON, too.
    return text.encode(errors="backslashreplace").decode()


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
