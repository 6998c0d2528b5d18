"""Readers of datasets that keep the contract, and readers that break one point of it each.

They are tested by their names, as `module:NAME:FOLDER`; `FAULTS` says what has to be found.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from data_prep.datasets.dataset import Dataset, DatasetReader
from data_prep.datasets.registry import ProceduralObject
from data_prep.failures import BadInput
from data_prep.scene import PointCloud

_OPENED = itertools.count()


@dataclass(frozen=True)
class Odd(ProceduralObject):
    """One of the embedded objects with something wrong about it."""

    fault: str = ""

    @property
    def object_id(self):
        return "same" if self.fault == "ids" else super().object_id

    def fingerprint(self):
        if self.fault == "fingerprints":
            return str(id(self))
        return "same" if self.fault == "one-fingerprint" else super().fingerprint()

    def cloud(self, rng, count=2048):
        if self.fault == "clouds":
            rng = np.random.default_rng()
        cloud = super().cloud(rng, count)
        if self.fault == "no-points":
            return PointCloud(cloud.points[:0])
        return replace(cloud, points=cloud.points * 7) if self.fault == "scale" else cloud

    def views(self, count, rng):
        views = super().views(count, rng)
        return views[:2] if self.fault == "few-views" else views

    def truth(self, views):
        images = super().truth(views)
        if self.fault == "float-truth":
            return images / 255
        return np.full_like(images, 255) if self.fault == "white" else images

    def cloud_and_truth(self, rng, views):
        cloud, images = super().cloud_and_truth(rng, views)
        if self.fault == "both":
            images = images // 2
        return cloud, images


class Local(ProceduralObject):
    """No dataclass of its own: what it adds is lost on the way to a worker."""

    def __init__(self, *arguments):
        super().__init__(*arguments)
        object.__setattr__(self, "handle", lambda: None)


def _read(fault, spec, folder):
    objects = tuple(Odd("chair", "test", index, fault) for index in range(4))
    if fault == "shrinks" and next(_OPENED):
        objects = objects[:3]
    if fault == "local":
        objects = tuple(Local("chair", "test", index) for index in range(4))
    return Dataset(spec, ("chair",), objects)


def _refuse(spec, folder):
    raise BadInput(f"{folder}/list.csv: no such list; make one")


def _list(spec, folder):
    return list(_read("", spec, folder).finite)


def _empty(spec, folder):
    return Dataset(spec, ("chair",), ())


ODD = (
    *("ids", "fingerprints", "one-fingerprint", "clouds", "scale", "no-points", "few-views"),
    *("white", "float-truth", "both", "shrinks", "local"),
)
READERS = {
    "GOOD": partial(_read, ""),
    **{fault.upper().replace("-", "_"): partial(_read, fault) for fault in ODD},
    "REFUSES": _refuse,
    "A_LIST": _list,
    "EMPTY": _empty,
}
globals().update({n: DatasetReader("made", read, "made up") for n, read in READERS.items()})

# By name: the finding that tells the fault, what it says, and whether it blocks a run.
FAULTS = {
    "IDS": ("objects", "two objects have the same class and id", True),
    "FINGERPRINTS": ("objects", "other fingerprints when it is opened again", True),
    "ONE_FINGERPRINT": ("objects", "two objects have the same fingerprint", True),
    "CLOUDS": ("repeatable", "; take all randomness from `rng`", True),
    "SCALE": ("clouds", "bring objects to the unit sphere", True),
    "NO_POINTS": ("clouds", "has no points", True),
    "FEW_VIEWS": ("views", "2 of 3 views", True),
    "WHITE": ("truth", "its true images are white", True),
    "FLOAT_TRUTH": ("truth", "float64 [2, 128, 128, 3], expected uint8", True),
    "BOTH": ("cloud and truth", "cloud_and_truth gives other images", True),
    "SHRINKS": ("identity", "4 objects, and 3 or others when it is opened again", True),
    "LOCAL": ("pickling", "local object", True),
    "REFUSES": ("identity", "list.csv: no such list; make one", True),
    "A_LIST": ("identity", "gives no Dataset", True),
    "EMPTY": ("identity", "no chair in the split 'test'", True),
}
