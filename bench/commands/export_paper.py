"""Any dataset as a tree in the paper's layout: `bench data export`.

Clouds and views are those that a run with the same seed takes, so that a run on the tree gives the
same tables as one on the dataset itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from bench.catalogue.suites import Limits
from bench.running.isolation import Lost, run_tasks
from bench.running.progress import progress
from data_prep.dataset_paper import PICTURES
from data_prep.datasets import open_dataset
from data_prep.failures import BadInput, CannotWrite
from data_prep.randomness import generator
from data_prep.scene_objects import SceneObject
from data_prep.write_paper_tree import check_names, write_object, write_split

LIMITS = Limits(time_s=120.0, memory_gib=4.0)  # for one object
ENDLESS_LIMIT = 24  # objects of a class where the dataset has no end: those of chair-robustness


@dataclass(frozen=True)
class Exported:
    """How many objects were written, the split file, and why the others were not, a line each.

    The split names these others too: a run on the tree has them as failures, as it should.
    """

    written: int
    split_file: Path
    failures: tuple[str, ...]


@dataclass(frozen=True)
class _Task:
    object: SceneObject
    seed: int
    root: Path


def export(
    dataset: str, classes: Sequence[str], limit: int | None, seed: int, out: Path, workers: int
) -> Exported:
    """Write the test objects of some classes, each in a worker: files are not trusted.

    Raises BadInput for what the user has to mend: an unknown dataset or class, bare clouds, an id
    that is no name of a file, a folder that is not empty.
    """
    if limit is not None and limit < 1:
        raise BadInput(f"--limit {limit}: must be at least 1")
    source = open_dataset(dataset)
    by_class = {name: source.objects(name, limit, ENDLESS_LIMIT) for name in classes}
    objects = [obj for found in by_class.values() for obj in found]
    for obj in objects:
        check_names(obj.class_name, obj.object_id)
        if not obj.has_truth:
            raise BadInput(f"{dataset}: {obj.object_id} is a bare cloud, without pictures to write")
    if out.is_file() or (out.is_dir() and any(out.iterdir())):
        raise BadInput(f"{out}: not empty; give a new --out")
    failures: dict[str, str] = {}
    tasks = [_Task(obj, seed, out) for obj in objects]
    with progress("export", len(tasks)) as advance:
        for task, result in run_tasks(tasks, _write_one, min(workers, len(tasks)), LIMITS):
            reason = result.reason if isinstance(result, Lost) else result
            if reason:
                failures[f"{task.object.class_name}/{task.object.object_id}"] = reason
            advance(len(failures))
    ids = {name: [obj.object_id for obj in found] for name, found in by_class.items()}
    split_file = write_split(out, classes[0] if len(classes) == 1 else "all", ids)
    told = tuple(f"{name}: {reason}" for name, reason in sorted(failures.items()))
    return Exported(len(objects) - len(failures), split_file, told)


def _write_one(task: _Task) -> str:
    """Why the object could not be written; empty where it was."""
    obj = task.object
    names = (obj.class_name, obj.object_id)
    try:
        views = obj.views(PICTURES, generator(task.seed, "views", *names))
        cloud, truth = obj.cloud_and_truth(generator(task.seed, "cloud", *names), views)
        write_object(task.root, *names, cloud, views, truth)
    except CannotWrite:
        raise
    except BadInput as error:
        return str(error)
    return ""
