"""Where a finished run keeps its pictures, and its clouds made again. Reads, never writes."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench.artifacts import read_artifact
from bench.lookup import find
from bench.methods import FLOOR
from bench.plan import Protocol, artifact_path, plan
from bench.record import GROUND_TRUTH
from bench.store import JOURNAL
from bench.suites import SUITES
from bench.work import Job, cloud_of
from data_prep.datasets import open_dataset
from data_prep.failures import BadInput

CACHED = 32  # artifacts held in memory, of about 1 MB each


class Item(NamedTuple):
    """One method on one cloud; of a ground truth the method is GROUND_TRUTH, without condition."""

    method: str
    condition: str
    class_name: str
    object: str

    @property
    def truth(self) -> Item:
        """The true pictures of its object."""
        return Item(GROUND_TRUTH, "", self.class_name, self.object)


@dataclass(frozen=True, eq=False)
class Sources:
    """Pictures and clouds by item.

    artifacts  where the pictures are
    clouds     jobs whose clouds are the items', by item with an empty method
    unseen     why there are no clouds; empty where there are
    """

    artifacts: Mapping[Item, Path]
    clouds: Mapping[Item, Job]
    unseen: str

    def __post_init__(self) -> None:
        object.__setattr__(self, "_read", lru_cache(CACHED)(_read))
        object.__setattr__(self, "_sampled", lru_cache(CACHED)(_sampled))

    def pictures(self, item: Item) -> NDArray[np.uint8] | None:
        """The pictures [V, H, W, 3] of an item; None where they are missing or unreadable."""
        path = self.artifacts.get(item)
        return None if path is None else self._read(path)  # type: ignore[attr-defined]

    def points(self, item: Item) -> NDArray[np.float32] | None:
        """The points [N, 3] that an item was drawn from; None where they cannot be made again."""
        job = self.clouds.get(item._replace(method=""))
        return None if job is None else self._sampled(job)  # type: ignore[attr-defined]


def open_sources(
    directory: Path, manifest: Mapping[str, Any], records: pd.DataFrame, shown: Sequence[Item]
) -> Sources:
    """What there is of a run; clouds only of the objects and conditions of `shown`.

    The journal may know an item twice, where a version was raised between two starts: the artifact
    is the one whose records are those of `records`.
    """
    times = _times(records)
    artifacts: dict[Item, Path] = {}
    for key, item, prepare_s in _journal(directory):
        if item.method == GROUND_TRUTH or times.get(item) == prepare_s:
            path = artifact_path(directory, key)
            if path.is_file():
                artifacts[item] = path
    try:
        return Sources(artifacts, _cloud_jobs(directory, manifest, shown), "")
    except BadInput as error:
        return Sources(artifacts, {}, f"The clouds cannot be made again: {error}.")


def _times(records: pd.DataFrame) -> dict[Item, float]:
    """The time of each item's first view, which no other start has to the last digit."""
    ok = records[(records["outcome"] == "ok") & (records["view"] == 0)]
    names = (ok[name].tolist() for name in ("method", "condition", "class", "object"))
    items = (Item(*map(str, of_item)) for of_item in zip(*names, strict=True))
    return dict(zip(items, ok["prepare_s"].tolist(), strict=True))


def _journal(directory: Path) -> list[tuple[str, Item, float | None]]:
    """Keys, items and times of all finished jobs with pictures, in the order of the journal.

    Lines that do not count (`bench.store`) are left alone.
    """
    found = []
    for shard in sorted((directory / JOURNAL).glob("*.jsonl")):
        for line in shard.read_bytes().split(b"\n"):
            checksum, _, body = line.partition(b" ")
            if not body or sha256(body).hexdigest().encode() != checksum:
                continue
            values = json.loads(body)
            first = values["records"][0]
            item = Item(first["method"], first["condition"], first["class_name"], first["object"])
            if values["artifact_sha256"] is not None:
                found.append((values["key"], item, first["prepare_s"]))
    return found


def _cloud_jobs(
    directory: Path, manifest: Mapping[str, Any], shown: Sequence[Item]
) -> dict[Item, Job]:
    """Raises BadInput where the dataset is no longer there."""
    suite = find(str(manifest["suite"]), SUITES, "suite")
    dataset, count = open_dataset(manifest["dataset"]), len(manifest["objects"])
    wanted = {(item.class_name, item.object) for item in shown}
    objects = tuple(
        obj
        for class_name in dict.fromkeys(name for name, _ in wanted)
        for obj in dataset.objects(class_name, count, count)
        if (obj.class_name, obj.object_id) in wanted
    )
    protocol = Protocol(
        suite=suite,
        dataset=dataset.id,
        methods=(FLOOR,),
        conditions=tuple(dict.fromkeys(item.condition for item in shown if item.condition)),
        objects=objects,
        views=manifest["views"],
        seed=manifest["seed"],
        device=manifest["device"],
        features=(),
        feature_identity={},
        environment={},
    )
    return {
        Item("", job.condition, job.object.class_name, job.object.object_id): job
        for job in plan(protocol, directory).items
    }


def _read(path: Path) -> NDArray[np.uint8] | None:
    if not zipfile.is_zipfile(path):  # NumPy would leave such a file open
        return None
    try:
        return read_artifact(path)["images"]
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None


def _sampled(job: Job) -> NDArray[np.float32] | None:
    try:
        return cloud_of(job).points
    except (BadInput, OSError):  # the file has gone, or is another one now
        return None
