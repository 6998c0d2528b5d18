"""The inspection of a dataset: what it has, what is wrong with it, and how it is to be read."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path, PurePosixPath
from typing import NamedTuple

import numpy as np

from bench.catalogue.suites import Limits
from bench.running.pool import WorkerFailure, run_tasks
from bench.running.protocol import name_of
from data_prep.clouds.far_points import note_on_scale
from data_prep.datasets.dataset import Dataset, first_names
from data_prep.datasets.exported import COLUMNS, METADATA, listed_files
from data_prep.datasets.objects import SceneObject
from data_prep.datasets.paper import READINGS, VIEWS, PaperObject, agreement, find_problems
from data_prep.datasets.registry import BareCloud, is_dataset, open_dataset, recognised
from data_prep.datasets.stored_meshes import MeshFile
from data_prep.failures import BadInput, MissingDependency, NoFaces
from data_prep.files.checksums import file_sha256
from data_prep.files.safe_read import files_below, is_regular_file
from data_prep.progress import progress
from data_prep.randomness import generator

_EXPORTED_SUFFIXES = (".csv", ".ply", ".png")
LIMITS = Limits(time_s=120.0, memory_gib=4.0)  # the limits of a worker that reads one object
_ENDLESS_SAMPLE = 3  # objects read of each class of a dataset that makes as many as one asks for
# Two ways to read the angles of a dataset are told apart only where the shares of points that fall
# on the object's silhouettes differ by more than this. Smaller differences say nothing: an object
# may look nearly the same from both sides, and the outermost points of its outline fall beside its
# pixels.
_INDIFFERENCE = 0.01
_UNUSABLE = "it cannot be used"


class Inspection(NamedTuple):
    """A report on a dataset.

    spec       the dataset as `bench run --dataset` takes it
    lines      the facts about the dataset, a line each
    irregular  the problems that were found, a line each
    clouds     whether all objects that were read are clouds without a mesh, which cannot be scored
    """

    spec: str
    lines: tuple[str, ...]
    irregular: tuple[str, ...]
    clouds: bool = False


class _ObjectReport(NamedTuple):
    """The findings on an object.

    problems   for each problem its kind, and the place or reason
    agreement  the share of the object's points that fall on its silhouettes, for each way to read
               the angles of its images; None for objects without images of their own
    bare       whether the object is a cloud without a mesh
    """

    problems: tuple[tuple[str, str], ...]
    agreement: tuple[float, ...] | None = None
    bare: bool = False


def inspect(location: str, sample: int, workers: int) -> Inspection:
    """Inspect a dataset ("shapenet:PATH"), or a folder whose layout is found out.

    `sample` objects of each class are read, spread evenly over those that a run would measure.
    Raises BadInput where the location holds no dataset at all, and for a negative sample.
    """
    if sample < 0:
        raise BadInput(f"--sample {sample}: must be at least 0")
    spec = location if is_dataset(location) else recognised(location)
    dataset = open_dataset(spec)
    chosen = _sample(dataset, sample)
    reports: dict[str, _ObjectReport] = {}
    with progress("reading", len(chosen)) as advance:
        # Files of strangers may crash or hang a library, so that they are read in workers.
        for obj, outcome in run_tasks(chosen, _examine, max(1, min(workers, len(chosen))), LIMITS):
            if isinstance(outcome, WorkerFailure):
                outcome = _ObjectReport((("it cannot be read", outcome.reason),))
            reports[name_of(obj)] = outcome
            advance(sum(bool(report.problems) for report in reports.values()))
    fit, misfit = _fit(reports)
    clouds = bool(reports) and all(report.bare for report in reports.values())
    problems = [line for line in _grouped(reports) if not (clouds and _UNUSABLE in line)]
    irregular = (*dataset.irregular, *_without_images(dataset), *problems, *misfit)
    lines = [f"layout       {dataset.layout}", f"orientation  {dataset.orientation}"]
    lines += _counts(dataset)
    if dataset.left_out:
        lines.append(f"left out     {dataset.left_out}")
    lines += [*_checksum(dataset), f"read         {len(chosen)} objects", *fit]
    if clouds:
        lines.append("clouds       points without faces: they can be drawn, not scored")
    return Inspection(spec, tuple(lines), irregular, clouds)


def _counts(dataset: Dataset) -> list[str]:
    """Return a line with the number of objects for each class, by split."""
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


def _checksum(dataset: Dataset) -> list[str]:
    """Return a line with one SHA-256 for a folder of meshes; no line for any other dataset.

    It is the checksum of the lines that `sha256sum` prints for the files of meshes, sorted by name.
    Files of materials are left out.
    """
    objects = [obj for obj in dataset.finite or () if isinstance(obj, MeshFile)]
    try:
        lines = {name_of(obj): f"{file_sha256(obj.path)}  {name_of(obj)}\n" for obj in objects}
    except BadInput:
        return []  # a file cannot be read; the report on the objects says which
    if not lines:
        return []
    text = "".join(lines[name] for name in sorted(lines))
    digest = hashlib.sha256(text.encode()).hexdigest()
    return [f"checksum     {digest} of {len(lines)} files"]


def _sample(dataset: Dataset, sample: int) -> list[SceneObject]:
    """Return up to `sample` objects of each class, spread evenly over those of the class."""
    chosen: list[SceneObject] = []
    for name in dataset.classes or ("",):
        if dataset.finite is None:
            chosen += dataset.objects(name, min(sample, _ENDLESS_SAMPLE), 0)
            continue
        pool = dataset.splits.get(dataset.measured, ()) or dataset.finite
        of_class = [obj for obj in pool if not name or obj.class_name == name]
        count = min(sample, len(of_class))
        rows = np.linspace(0, len(of_class) - 1, count).round().astype(int)
        chosen += [of_class[row] for row in rows]
    return chosen


def _examine(obj: SceneObject) -> _ObjectReport:
    if isinstance(obj, PaperObject):
        shares = None
        with suppress(BadInput):  # `find_problems` reports what cannot be read
            shares = tuple(agreement(obj))
        return _ObjectReport(tuple(find_problems(obj)), shares)
    try:
        small = note_on_scale(obj.cloud(generator("inspect")).points)
    except MissingDependency:
        raise
    except BadInput as error:
        problems = ((_UNUSABLE, str(error)),)
        # A file without faces may be a cloud, but only in a plain folder of files. The meshes of
        # ShapeNet and ModelNet lie in folders of their own, and none is meant to be a cloud.
        if not isinstance(obj, MeshFile) or obj.folder is not None:
            return _ObjectReport(problems)
        if not isinstance(error, NoFaces):
            return _ObjectReport(problems)
        cloud = _examine(BareCloud(obj.class_name, obj.object_id, obj.path))
        return _ObjectReport((*problems, *cloud.problems), bare=cloud.bare)
    problems = (("it is small in its images", small),) if small else ()
    return _ObjectReport(problems, bare=isinstance(obj, BareCloud))


def _grouped(reports: Mapping[str, _ObjectReport]) -> list[str]:
    """Return a line for each kind of problem, with the number of its objects and the first one."""
    groups: dict[str, dict[str, str]] = {}
    for name, report in sorted(reports.items()):
        for kind, place in report.problems:
            groups.setdefault(kind, {}).setdefault(name, place)
    firsts = {kind: ": ".join(next(iter(places.items()))) for kind, places in groups.items()}
    return [
        f"{len(groups[kind])} of {len(reports)} read: {kind} (first {first})"
        for kind, first in firsts.items()
    ]


def _without_images(dataset: Dataset) -> list[str]:
    """Return lines on the objects that lack images, and on those that lack the file of views."""
    gaps, blind = [], []
    for obj in dataset.finite or ():
        if isinstance(obj, PaperObject) and obj.renders.is_dir():
            missing = sum(not is_regular_file(path) for path in obj.image_files())
            if missing:
                gaps.append(f"{name_of(obj)} ({missing})")
            if not is_regular_file(obj.renders / VIEWS):
                blind.append(name_of(obj))
    return [
        *([f"{len(gaps)} objects lack images: {first_names(gaps)}"] if gaps else []),
        *([f"{len(blind)} objects lack {VIEWS}: {first_names(blind)}"] if blind else []),
    ]


def _fit(reports: Mapping[str, _ObjectReport]) -> tuple[list[str], list[str]]:
    """Return a line on how well the clouds fall on the objects in their images.

    The line is in the first list, or in the second one, of irregular lines, where another way to
    read the angles fits better. Both are empty for objects without images.
    """
    shares = [report.agreement for report in reports.values() if report.agreement is not None]
    if not shares:
        return [], []
    means = np.mean(shares, axis=0)
    best = 1 + int(np.argmax(means[1:]))
    sense, turn = READINGS[best]
    other = f"{'the same' if sense > 0 else 'the other'} sense, turned by {turn} degrees"
    message = f"{means[0]:.1%} of the points fall on the object in their images"
    against = f"{means[best]:.1%} for the next best reading of the azimuth ({other})"
    if means[best] > means[0] + _INDIFFERENCE:
        return [], [f"angles do not fit: {message}, {against}"]
    return [f"angles       {message}; {against}"], []


def verify(folder: Path) -> tuple[int, list[tuple[str, str]]]:
    """Compare the files of an export with its own list of files and checksums.

    Return the number of files that are as the list says, and for each other file what is wrong
    ("MISSING", "CHANGED" or "FURTHER") and its name. Raises BadInput for a missing folder, and for
    one that is no export.
    """
    if not folder.is_dir():
        raise BadInput(f"{folder}: no such folder; give the folder of an export")
    if not (folder / METADATA).is_file():
        if any((folder / name).is_file() for name in COLUMNS):
            raise BadInput(
                f"{folder}: an export without its {METADATA}, which has the checksums of its "
                "lists; fetch that file, or export it again"
            )
        raise BadInput(
            f"{folder}: is no export; give the folder that 'bench data export' wrote, or use "
            "'bench data inspect', which prints the checksum of a folder of meshes"
        )
    wanted = listed_files(folder)
    files = {
        path.relative_to(folder).as_posix(): path
        for name in sorted({PurePosixPath(name).parts[0] for name in wanted})
        for path in _files_at(folder / name)
    }
    common = wanted.keys() & files.keys()
    kinds = {
        "MISSING": wanted.keys() - files.keys(),
        "CHANGED": {name for name in common if file_sha256(files[name]) != wanted[name]},
        "FURTHER": files.keys() - wanted.keys(),
    }
    differing = [(kind, name) for kind, names in kinds.items() for name in sorted(names)]
    return len(common) - len(kinds["CHANGED"]), differing


def _files_at(place: Path) -> tuple[Path, ...]:
    if place.is_dir():
        return files_below(place, _EXPORTED_SUFFIXES)[0]
    return (place,) if is_regular_file(place) else ()
