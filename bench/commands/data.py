"""What was understood of a dataset, and what is missing or odd in it: `bench data inspect`; whether
a folder is an export, or the set of real meshes of the documentation: `bench data verify`; and a
run's inputs as files: `bench data export`.

Folders are listed in full; files are read of some objects of each class, in workers, because nobody
vouches for them.
"""

from __future__ import annotations

import csv
import shlex
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Annotated

import numpy as np
import typer

from bench.catalogue.suites import Limits
from bench.commands.options import (
    RUN_OPTIONS,
    SETTINGS,
    Group,
    OptionSpec,
    WorkersOption,
    options_from_dataclass,
    worker_count,
)
from bench.running.environment import cores
from bench.running.export import export
from bench.running.isolation import WorkerFailure, run_tasks
from bench.running.options import Options
from bench.tables.markdown import visible
from bench.tables.published import RESULTS
from data_prep.datasets.dataset import Dataset, listed
from data_prep.datasets.exported import COLUMNS, METADATA, listed_files
from data_prep.datasets.objects import SceneObject
from data_prep.datasets.paper import VIEWS, PaperObject
from data_prep.datasets.paper_checks import READINGS, agreement, find_problems
from data_prep.datasets.registry import BareCloud, is_dataset, layout_of, open_dataset
from data_prep.failures import BadInput, MissingDependency, NoFaces
from data_prep.files.checksums import file_sha256
from data_prep.files.clouds import CLOUD_SUFFIXES
from data_prep.files.meshes import SUFFIXES
from data_prep.files.safe_read import is_regular_file
from data_prep.progress import progress
from data_prep.randomness import generator

REAL_MESHES = RESULTS / "real-meshes.csv"
EXPORTED_SUFFIXES = (".csv", ".ply", ".png")
LIMITS = Limits(time_s=120.0, memory_gib=4.0)  # for one object
ENDLESS_SAMPLE = 3  # objects of a class where the dataset has no end
# Readings of the angles closer than this are not distinguished: an object that looks nearly the
# same from both sides, with the outermost points of its outlines beside its pixels.
INDIFFERENCE = 0.01


@dataclass(frozen=True)
class Inspection:
    """The lines of a report, and what is irregular, a line each.

    spec    the dataset as `bench run` takes it
    clouds  whether all that was read are clouds without a mesh, which cannot be scored
    """

    spec: str
    lines: tuple[str, ...]
    irregular: tuple[str, ...]
    clouds: bool = False


@dataclass(frozen=True)
class _Examined:
    """What an object showed: what is odd, and where; how well its cloud fits its images.

    bare  whether it is a cloud without a mesh
    """

    odd: tuple[tuple[str, str], ...]
    agreement: tuple[float, ...] | None = None
    bare: bool = False


def inspect(location: str, sample: int, workers: int) -> Inspection:
    """Look at a dataset ("shapenet:PATH"), or at a folder, whose layout is found out.

    `sample` objects of each class are read, spread over those that are measured. Raises BadInput
    where there is nothing to be used at all.
    """
    if sample < 0:
        raise BadInput(f"--sample {sample}: must be at least 0")
    spec = location if is_dataset(location) else f"{layout_of(location)}:{location}"
    dataset = open_dataset(spec)
    chosen = _sample(dataset, sample)
    examined: dict[str, _Examined] = {}
    with progress("reading", len(chosen)) as advance:
        for obj, found in run_tasks(chosen, _examine, max(1, min(workers, len(chosen))), LIMITS):
            if isinstance(found, WorkerFailure):
                found = _Examined((("it cannot be read", found.reason),))
            examined[f"{obj.class_name}/{obj.object_id}"] = found
            advance(sum(bool(one.odd) for one in examined.values()))
    fit, misfit = _fit(examined)
    clouds = bool(examined) and all(one.bare for one in examined.values())
    odd = [] if clouds else _grouped(examined)
    irregular = (*dataset.irregular, *_without_images(dataset), *odd, *misfit)
    lines = (
        f"layout       {dataset.layout}",
        f"orientation  {dataset.orientation}",
        *_counts(dataset),
        f"read         {len(chosen)} objects",
        *fit,
        *(("clouds       points without faces: they can be drawn, not scored",) if clouds else ()),
    )
    return Inspection(spec, lines, irregular, clouds)


def _counts(dataset: Dataset) -> list[str]:
    """Objects by class and split."""
    if dataset.finite is None:
        return [f"classes      {', '.join(dataset.classes)}: as many objects as one asks for"]
    if not dataset.classes:
        return [f"classes      none: {len(dataset.finite)} objects for any class"]
    pools: dict[str, Sequence[SceneObject]] = {str(s): o for s, o in dataset.splits.items()}
    pools = pools or {"objects": dataset.finite}
    lines = []
    for name in (*dataset.classes, "all"):
        counts = [
            f"{split} {sum(name in ('all', obj.class_name) for obj in objects)}"
            for split, objects in pools.items()
        ]
        lines.append(f"class        {name}: {', '.join(counts)}")
    if not dataset.splits:
        lines.append("splits       none: all objects are taken")
    return lines


def _sample(dataset: Dataset, sample: int) -> list[SceneObject]:
    chosen: list[SceneObject] = []
    for name in dataset.classes or ("",):
        if dataset.finite is None:
            chosen += dataset.objects(name, min(sample, ENDLESS_SAMPLE), 0)
            continue
        pool = dataset.splits.get(dataset.measured, ()) or dataset.finite
        own = [obj for obj in pool if not name or obj.class_name == name]
        rows = np.linspace(0, len(own) - 1, min(sample, len(own))).round().astype(int)
        chosen += [own[row] for row in rows]
    return chosen


def _examine(obj: SceneObject) -> _Examined:
    if isinstance(obj, PaperObject):
        odd = tuple(find_problems(obj))
        try:
            return _Examined(odd, tuple(agreement(obj)))
        except BadInput:  # printed above
            return _Examined(odd)
    try:
        obj.cloud(generator("inspect"))
    except MissingDependency:
        raise
    except BadInput as error:
        bare = isinstance(error, NoFaces) and Path(obj.object_id).suffix.lower() in CLOUD_SUFFIXES
        return _Examined((("it cannot be used", str(error)),), bare=bare)
    return _Examined((), bare=isinstance(obj, BareCloud))


def _grouped(examined: Mapping[str, _Examined]) -> list[str]:
    """What is odd about the objects that were read, a line for each kind."""
    groups: dict[str, dict[str, str]] = {}
    for name, found in sorted(examined.items()):
        for kind, where in found.odd:
            groups.setdefault(kind, {}).setdefault(name, where)
    lines = []
    for kind, where in groups.items():
        name, detail = next(iter(where.items()))
        lines.append(f"{len(where)} of {len(examined)} read: {kind} (first {name}: {detail})")
    return lines


def _without_images(dataset: Dataset) -> list[str]:
    """Objects that have a folder of images with gaps."""
    gaps, blind = [], []
    for obj in dataset.finite or ():
        if isinstance(obj, PaperObject) and obj.renders.is_dir():
            missing = sum(not is_regular_file(path) for path in obj.image_files())
            name = f"{obj.class_name}/{obj.object_id}"
            if missing:
                gaps.append(f"{name} ({missing})")
            if not is_regular_file(obj.renders / VIEWS):
                blind.append(name)
    return [
        *([f"{len(gaps)} objects lack pictures: {listed(gaps)}"] if gaps else []),
        *([f"{len(blind)} objects lack {VIEWS}: {listed(blind)}"] if blind else []),
    ]


def _fit(examined: Mapping[str, _Examined]) -> tuple[list[str], list[str]]:
    """How well clouds and images agree, and whether another reading of the angles is better."""
    shares = [found.agreement for found in examined.values() if found.agreement is not None]
    if not shares:
        return [], []
    means = np.mean(shares, axis=0)
    best = 1 + int(np.argmax(means[1:]))
    sense, turn = READINGS[best]
    other = f"{'the same' if sense > 0 else 'the other'} sense, turned by {turn} degrees"
    message = f"{means[0]:.1%} of the points fall on the object in their pictures"
    against = f"{means[best]:.1%} for the next best reading of the azimuth ({other})"
    if means[best] > means[0] + INDIFFERENCE:
        return [], [f"angles do not fit: {message}, {against}"]
    return [f"angles       {message}; {against}"], []


@dataclass(frozen=True)
class Verification:
    """How a folder differs from a list of its files, by name."""

    missing: tuple[str, ...]
    changed: tuple[str, ...]
    further: tuple[str, ...]
    same: int


def verify(folder: Path, listing: Path = REAL_MESHES) -> Verification:
    """Compare the files of a folder with a list of files and checksums: its own where it is an
    export, else that of the real meshes.

    Raises BadInput where the folder or the list is not there.
    """
    if not folder.is_dir():
        raise BadInput(f"{folder}: no such folder; give that of the meshes, or an export")
    if (folder / METADATA).is_file():
        wanted, suffixes = listed_files(folder), EXPORTED_SUFFIXES
    elif any((folder / name).is_file() for name in COLUMNS):
        raise BadInput(
            f"{folder}: an export without its {METADATA}, which has the checksums of its lists; "
            "fetch that file, or export it again"
        )
    elif not listing.is_file():
        raise BadInput(f"{listing}: not there; run from a checkout that has it")
    else:
        with listing.open(encoding="utf-8", newline="") as file:
            wanted = {row["file"]: row["sha256"] for row in csv.DictReader(file)}
        suffixes = SUFFIXES
    classes = {PurePosixPath(name).parts[0] for name in wanted}
    there = {
        path.relative_to(folder).as_posix(): path
        for name in sorted(classes)
        for path in sorted([folder / name, *(folder / name).rglob("*")])
        if path.suffix.lower() in suffixes and is_regular_file(path)
    }
    common = wanted.keys() & there.keys()
    changed = sorted(name for name in common if file_sha256(there[name]) != wanted[name])
    return Verification(
        missing=tuple(sorted(wanted.keys() - there.keys())),
        changed=tuple(changed),
        further=tuple(sorted(there.keys() - wanted.keys())),
        same=len(common) - len(changed),
    )


app = typer.Typer(cls=Group, help="Inspect, verify and export datasets.", **SETTINGS)


@app.command("inspect")
def inspect_data(
    location: Annotated[
        str,
        typer.Argument(
            metavar="PATH", help="A folder, or a dataset as of 'bench run', shapenet:PATH say."
        ),
    ],
    sample: Annotated[int, typer.Option(help="Objects read of each class.")] = 10,
    workers: WorkersOption = None,
) -> None:
    """Show what a dataset holds. Exit 1 if something is missing or odd."""
    found = inspect(location, sample, worker_count(workers) or cores())
    for line in found.lines:
        print(visible(line))
    for line in found.irregular:
        print(f"IRREGULAR    {visible(line)}")
    use = "bench render FILE" if found.clouds else f"--dataset {shlex.quote(found.spec)}"
    print(f"use          {use}")
    if found.irregular:
        raise typer.Exit(1)


@app.command("verify")
def verify_data(
    folder: Annotated[
        Path,
        typer.Argument(
            metavar="FOLDER", help="An export, or the real meshes in sub-folders by class."
        ),
    ],
) -> None:
    """Say whether a folder holds a whole export, or the real meshes of the docs. Exit 1 if not."""
    found = verify(folder)
    print(f"{found.same} files are those of the list")
    for what in ("missing", "changed", "further"):
        for name in getattr(found, what):
            print(f"{what.upper():<8} {visible(name)}")
    if found.missing or found.changed or found.further:
        raise typer.Exit(1)


EXPORT_OPTIONS: dict[str, str | OptionSpec] = {
    "suite": OptionSpec("The suite whose objects and views these are.", default="chair-robustness"),
    "dataset": RUN_OPTIONS["dataset"],
    "conditions": "Conditions, comma-separated, or 'all'. Default: the suite's.",
    **{name: RUN_OPTIONS[name] for name in ("limit", "views", "workers", "seed")},
}


@app.command("export")
@options_from_dataclass(Options, EXPORT_OPTIONS)
def export_data(
    options: Options, out: Annotated[Path, typer.Option(help="The new folder.")]
) -> None:
    """Write the clouds, views and true images of a run as files with checksums."""
    print(f"{export(options, out)} objects written to {out}", file=sys.stderr)
    print(f"use          --dataset {shlex.quote(f'exported:{out}')}")
