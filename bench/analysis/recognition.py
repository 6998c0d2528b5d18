"""Does an image show the view, the object and the class that it should? Networks are asked.

Pure functions of records and features. The judge (`bench.judges.judge`) gives the direction of view
and a shape code from an image alone: a method that ignores its cloud, or the view, may have good
SSIM, but is found out here. `true-mesh` goes through the same and shows how far the judge itself
errs. The classifier behind `fd-views` gives the class of an object, and how surely an image is
taken for what it shows is the paper's "class similarity" as a number. Its last layer is applied to
the features that a run has kept, so that nothing is drawn or loaded again.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import safe_open

from bench.records.features import Features, Picture
from bench.records.record import GROUND_TRUTH
from data_prep.failures import BadInput

Floats = NDArray[np.float64]
ELEVATION_UNIT_DEG = 40.0  # the judge's elevation is in these
AT_ONCE = 2**16  # numbers of the differences that are in memory
VIEW_COLUMNS = 3  # sine and cosine of the azimuth, elevation; the rest is the shape code


def azimuth_error_deg(answers: NDArray[Any], azimuth_deg: Floats) -> Floats:
    """How far the judged azimuth is from the one asked for, [n], 0..180 degrees.

    answers [n, 3 + d]; azimuth_deg [n], any finite value: both are wrapped at 360.
    """
    judged = np.degrees(np.arctan2(answers[:, 0].astype(float), answers[:, 1].astype(float)))
    return np.abs((judged - azimuth_deg + 180.0) % 360.0 - 180.0)


def elevation_error_deg(answers: NDArray[Any], elevation_deg: Floats) -> Floats:
    """How far the judged elevation is from the one asked for, [n], degrees."""
    return np.abs(ELEVATION_UNIT_DEG * answers[:, 2].astype(float) - elevation_deg)


@dataclass(frozen=True, eq=False)
class Gallery:
    """The true shape codes of all objects of a class, to find judged ones among.

    class_name
    objects  the G objects, sorted
    sums     float64 [G, d], over all true pictures of an object
    counts   how many those are, int [G]
    codes    float64 [d] of each true picture
    """

    class_name: str
    objects: tuple[str, ...]
    sums: Floats
    counts: NDArray[np.int64]
    codes: dict[Picture, Floats]

    def without(self, view: int) -> Floats:
        """The mean code [G, d] of each object over its true pictures except this view.

        So that a picture is never compared with the true picture of its own view: it has to be
        known by its shape, and the truth itself is no exception. NaN for an object that has no
        other picture.
        """
        sums, counts = self.sums.copy(), self.counts.astype(float)
        for i, obj in enumerate(self.objects):
            code = self.codes.get((obj, view))
            if code is not None:
                sums[i] -= code
                counts[i] -= 1
        counts[counts == 0] = np.nan
        return sums / counts[:, None]


def gallery(answers: Features, class_name: str) -> Gallery:
    """The gallery of a class, from the ground truth of a run."""
    truth = (GROUND_TRUTH, "", class_name)
    pictures = answers.pictures(*truth)
    objects = tuple(sorted({obj for obj, _ in pictures}))
    if not pictures:
        return Gallery(class_name, (), np.empty((0, 0)), np.empty(0, np.int64), {})
    codes = _codes(answers.of(*truth, pictures))
    place = {obj: i for i, obj in enumerate(objects)}
    member = np.array([place[obj] for obj, _ in pictures])
    sums = np.zeros((len(objects), codes.shape[1]))
    np.add.at(sums, member, codes)
    counts = np.bincount(member, minlength=len(objects))
    return Gallery(class_name, objects, sums, counts, dict(zip(pictures, codes, strict=True)))


def why_no_retrieval(among: Gallery) -> str:
    """The reason why nothing can be found in this gallery; empty where it can."""
    if len(among.objects) < 2:
        return f"{len(among.objects)} object: there is nothing to tell it from; run at least 2"
    if among.counts.min() < 2:
        return "1 view an object: none is left to know it by; run at least 2"
    return ""


def found(among: Gallery, answers: NDArray[Any], pictures: list[Picture]) -> Floats:
    """1 for each picture whose judged code is nearest to the right object of all, else 0; [n].

    Euclidean; of objects equally near the first by name is taken to be meant.
    """
    codes = _codes(answers)
    hits = np.zeros(len(pictures))
    for view in sorted({view for _, view in pictures}):
        rows = [i for i, (_, v) in enumerate(pictures) if v == view]
        means = among.without(view)
        at_once = max(1, AT_ONCE // max(means.size, 1))
        for start in range(0, len(rows), at_once):
            some = rows[start : start + at_once]
            distances = np.linalg.norm(codes[some][:, None] - means[None], axis=2)
            hits[some] = [
                among.objects[k] == pictures[i][0]
                for i, k in zip(some, distances.argmin(axis=1), strict=True)
            ]
    return hits


def _codes(answers: NDArray[Any]) -> Floats:
    return np.asarray(answers)[:, VIEW_COLUMNS:].astype(np.float64)


@dataclass(frozen=True, eq=False)
class ClassHead:
    """The layer that tells the class from features of length d.

    classes  the C classes, in the order of the rows
    weight   float64 [C, d]
    bias     float64 [C]
    """

    classes: tuple[str, ...]
    weight: Floats
    bias: Floats

    def confidence(self, features: NDArray[Any], class_name: str) -> Floats:
        """The probability [n], 0..1, that features [n, d] are given of showing this class.

        Softmax over the C classes, in float64. Raises KeyError for a class that the head does not
        know.
        """
        if class_name not in self.classes:
            raise KeyError(class_name)
        scores = features.astype(np.float64) @ self.weight.T + self.bias
        odds = np.exp(scores - scores.max(axis=1, keepdims=True))  # no overflow
        return odds[:, self.classes.index(class_name)] / odds.sum(axis=1)


def read_class_head(path: Path) -> ClassHead:
    """The head in the weights of `fd-views`. Raises BadInput for a file without one."""
    try:
        with safe_open(path, framework="np") as file:
            classes = tuple(json.loads((file.metadata() or {})["labels"])["classes"])
            weight, bias = (file.get_tensor(f"heads.class.{part}") for part in ("weight", "bias"))
    except Exception as error:  # safetensors raises types of its own
        reason = " ".join(str(error).split())
        raise BadInput(f"{path}: not the weights of fd-views ({reason}); reinstall") from error
    return ClassHead(classes, weight.astype(np.float64), bias.astype(np.float64))
