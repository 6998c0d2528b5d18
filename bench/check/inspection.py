"""The inspection of a dataset: what it has, what is wrong with it, and how it is to be read."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
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
from data_prep.files.clouds import CLOUD_SUFFIXES
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
# What differs in the reasons of one kind of failure: quoted texts, names of files, numbers.
_OF_ONE_OBJECT = re.compile(r"'[^']*'|[^\s:]*[\d/.][^\s:]*")


class Problem(NamedTuple):
    """A problem of an object.

    object  the object as CLASS/ID
    kind    the problem in words that other objects share, such as "it cannot be used"
    reason  the reason or the place, such as the message of the reader with its remedy
    cause   the reason without what belongs to this object alone; "" where the kind says all
    """

    object: str
    kind: str
    reason: str
    cause: str = ""


class Checksum(NamedTuple):
    """The SHA-256 of a folder of meshes, and the number of its files."""

    sha256: str
    files: int


@dataclass(frozen=True)
class Inspection:
    """A report on a dataset.

    spec       the dataset as `bench run --dataset` takes it
    dataset    the dataset itself
    counts     the number of objects of each class, and of "all", by split; "objects" is the split
               of a source without any; empty where the source has no end
    checksum   the checksum of a folder of meshes; None for any other dataset
    read       the number of objects that were read
    whole      whether these are all objects
    angles     a line on how well clouds and images fit; "" without images, and where they do not
    irregular  lines on what is missing or odd about the dataset as a whole
    problems   the problems of the objects that were read, sorted by object
    clouds     whether all objects that were read are clouds without a mesh, which cannot be scored
    """

    spec: str
    dataset: Dataset
    counts: Mapping[str, Mapping[str, int]]
    checksum: Checksum | None
    read: int
    whole: bool
    angles: str
    irregular: tuple[str, ...]
    problems: tuple[Problem, ...]
    clouds: bool

    @property
    def kinds(self) -> tuple[str, ...]:
        """Return a line for each kind and cause of problems: how many objects, and the first."""
        groups: dict[tuple[str, str], list[Problem]] = {}
        for problem in self.problems:
            groups.setdefault((problem.kind, problem.cause), []).append(problem)
        lines = []
        for problems in groups.values():
            first, count = problems[0], len({problem.object for problem in problems})
            line = f"{count} of {self.read} read: {first.kind} (first {first.object}: "
            lines.append(f"{line}{first.reason})")
        return tuple(lines)


class _ObjectReport(NamedTuple):
    """The findings on an object.

    problems   its problems
    agreement  the share of the object's points that fall on its silhouettes, for each way to read
               the angles of its images; None for objects without images of their own
    as_cloud   its problems where all objects are clouds without a mesh, so that none needs one;
               None for an object that is no such cloud
    """

    problems: tuple[Problem, ...]
    agreement: tuple[float, ...] | None = None
    as_cloud: tuple[Problem, ...] | None = None


def inspect(location: str, sample: int | None, workers: int) -> Inspection:
    """Inspect a dataset ("shapenet:PATH"), or a folder whose layout is found out.

    `sample` objects of each class are read, spread evenly over those that a run would measure; all
    objects of all splits for None. Raises BadInput where the location holds no dataset at all, for
    a negative sample, and for None where the dataset has no end.
    """
    if sample is not None and sample < 0:
        raise BadInput(f"--sample {sample}: must be at least 0")
    spec = location if is_dataset(location) else recognised(location)
    dataset = open_dataset(spec)
    every = _every_object(dataset)
    if sample is None and every is None:
        raise BadInput(
            f"--all: {spec} has as many objects as one asks for; give --sample with a number"
        )
    chosen = every if sample is None and every is not None else _sample(dataset, sample or 0)
    reports: list[tuple[str, _ObjectReport]] = []
    failed = 0
    with progress("reading", len(chosen)) as advance:
        # Files of strangers may crash or hang a library, so that they are read in workers.
        for obj, outcome in run_tasks(chosen, _examine, max(1, min(workers, len(chosen))), LIMITS):
            if isinstance(outcome, WorkerFailure):
                failure = Problem(name_of(obj), "it cannot be read", outcome.reason, outcome.reason)
                outcome = _ObjectReport((failure,))
            reports.append((name_of(obj), outcome))
            failed += bool(outcome.problems)
            advance(failed)
    reports.sort(key=lambda named: named[0])
    angles, misfit = _fit([report for _, report in reports])
    clouds = bool(reports) and all(report.as_cloud is not None for _, report in reports)
    problems: list[Problem] = []
    for _, report in reports:
        problems += (report.as_cloud or ()) if clouds else report.problems
    return Inspection(
        spec,
        dataset,
        _counts(dataset),
        _checksum(dataset),
        len(chosen),
        len(chosen) == len(every or ()),
        angles,
        (*dataset.irregular, *_without_images(dataset), *misfit),
        tuple(problems),
        clouds,
    )


def _counts(dataset: Dataset) -> dict[str, dict[str, int]]:
    if dataset.finite is None:
        return {}
    pools: dict[str, Sequence[SceneObject]] = {str(s): o for s, o in dataset.splits.items()}
    pools = pools or {"objects": dataset.finite}
    return {
        name: {
            split: sum(name in ("all", obj.class_name) for obj in objects)
            for split, objects in pools.items()
        }
        for name in (*dataset.classes, "all")
    }


def _checksum(dataset: Dataset) -> Checksum | None:
    """Return one checksum for a folder of meshes; None for any other dataset.

    It is the checksum of the lines that `sha256sum` prints for the files of meshes, sorted by name.
    Files of materials are left out.
    """
    objects = [obj for obj in dataset.finite or () if isinstance(obj, MeshFile)]
    try:
        lines = [(name_of(obj), f"{file_sha256(obj.path)}  {name_of(obj)}\n") for obj in objects]
    except BadInput:
        return None  # a file cannot be read; the report on the objects says which
    if not lines:
        return None
    text = "".join(line for _, line in sorted(lines))
    return Checksum(hashlib.sha256(text.encode()).hexdigest(), len(lines))


def _every_object(dataset: Dataset) -> list[SceneObject] | None:
    """Return all objects, with those that a split names and the disk lacks; None without an end."""
    if dataset.finite is None:
        return None
    listed = (obj for objects in dataset.splits.values() for obj in objects)
    # By identity, as objects of other packages need not be hashable.
    return list({id(obj): obj for obj in (*dataset.finite, *listed)}.values())


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
    name = name_of(obj)
    if isinstance(obj, PaperObject):
        shares = None
        with suppress(BadInput):  # `find_problems` reports what cannot be read
            shares = tuple(agreement(obj))
        problems = (Problem(name, kind, place, _cause(place)) for kind, place in find_problems(obj))
        return _ObjectReport(tuple(problems), shares)
    try:
        small = note_on_scale(obj.cloud(generator("inspect")).points)
    except MissingDependency:
        raise
    except BadInput as error:
        path = str(obj.path) if isinstance(obj, MeshFile | BareCloud) else ""
        reason = str(error)
        problem = Problem(name, _UNUSABLE, reason, _cause(reason.removeprefix(path)))
        if isinstance(obj, BareCloud):
            return _ObjectReport((problem,), as_cloud=(problem,))
        # A file without faces may be a cloud, but only in a plain folder of files. The meshes of
        # ShapeNet and ModelNet lie in folders of their own, and none is meant to be a cloud.
        if not isinstance(obj, MeshFile) or obj.folder is not None:
            return _ObjectReport((problem,))
        if not isinstance(error, NoFaces) or obj.path.suffix.lower() not in CLOUD_SUFFIXES:
            return _ObjectReport((problem,))
        cloud = _examine(BareCloud(obj.class_name, obj.object_id, obj.path))
        return _ObjectReport((problem,), as_cloud=cloud.problems)
    problems = [Problem(name, "it is small in its images", small)] if small else []
    if isinstance(obj, BareCloud):
        return _ObjectReport(tuple(problems), as_cloud=tuple(problems))
    if isinstance(obj, MeshFile):
        problems += _partly_read(name, obj)
    return _ObjectReport(tuple(problems))


def _partly_read(name: str, mesh: MeshFile) -> Iterator[Problem]:
    """Yield the problems of a mesh that can be read, but not with all that it names."""
    if missing := mesh.missing_files():
        yield Problem(name, "it names files that are not there", ", ".join(missing))
    for note in mesh.notes():
        if note.endswith("left out"):
            yield Problem(name, "a part of it is not read", note, _cause(note))
        elif not (missing and note.endswith("not there")):  # those are named above
            yield Problem(name, "colours are lost", note, _cause(note))


def _cause(reason: str) -> str:
    """Return a reason without its remedy, details, and what belongs to one object alone."""
    return _OF_ONE_OBJECT.sub("...", re.split(r"[;(]", reason)[0])


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


def _fit(reports: Sequence[_ObjectReport]) -> tuple[str, list[str]]:
    """Return a line on how well the clouds fall on the objects in their images.

    The line is in the list of irregular lines instead where another way to read the angles fits
    better. Both are empty for objects without images.
    """
    shares = [report.agreement for report in reports if report.agreement is not None]
    if not shares:
        return "", []
    means = np.mean(shares, axis=0)
    best = 1 + int(np.argmax(means[1:]))
    sense, turn = READINGS[best]
    other = f"{'the same' if sense > 0 else 'the other'} sense, turned by {turn} degrees"
    message = f"{means[0]:.1%} of the points fall on the object in their images"
    against = f"{means[best]:.1%} for the next best reading of the azimuth ({other})"
    if means[best] > means[0] + _INDIFFERENCE:
        return "", [f"angles do not fit: {message}, {against}"]
    return f"{message}; {against}", []


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
