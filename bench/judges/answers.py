"""Readings of the judge's answers: the view of an image, and which object it shows.

They are pure functions of `bench.judges.judge.judge`'s answers, without the network.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_prep.arrays import Floats

ImageKey = tuple[str, int]  # object, view
ELEVATION_UNIT_DEG = 40.0  # the judge's elevation is in these
AT_ONCE = 2**16  # distances that are in memory
VIEW_COLUMNS = 3  # sine and cosine of the azimuth, elevation; the rest is the shape code


def azimuth_error_deg(answers: NDArray[Any], azimuth_deg: Floats) -> Floats:
    """Return the error of the judged azimuth against the requested one, [n], 0..180 degrees.

    answers [n, 3 + d]; azimuth_deg [n], any finite value: both are wrapped at 360.
    """
    judged = np.degrees(np.arctan2(answers[:, 0].astype(float), answers[:, 1].astype(float)))
    return np.abs((judged - azimuth_deg + 180.0) % 360.0 - 180.0)


def elevation_error_deg(answers: NDArray[Any], elevation_deg: Floats) -> Floats:
    """Return the error of the judged elevation against the requested one, [n], in degrees."""
    return np.abs(ELEVATION_UNIT_DEG * answers[:, 2].astype(float) - elevation_deg)


@dataclass(frozen=True, eq=False)
class Gallery:
    """The true shape codes of all objects of a class, among which judged ones are looked up.

    class_name
    objects  the G objects, sorted
    sums     float64 [G, d], over all true images of an object
    counts   how many those are, int [G]
    codes    float64 [d] of each true image
    """

    class_name: str
    objects: tuple[str, ...]
    sums: Floats
    counts: NDArray[np.int64]
    codes: dict[ImageKey, Floats]

    def without(self, view: int) -> Floats:
        """Return the mean code [G, d] of each object over its true images except this view.

        So an image is never compared with the true image of its own view: it has to be known by its
        shape, and the truth itself is no exception. NaN for an object that has no other image.
        """
        sums, counts = self.sums.copy(), self.counts.astype(float)
        for i, obj in enumerate(self.objects):
            code = self.codes.get((obj, view))
            if code is not None:
                sums[i] -= code
                counts[i] -= 1
        counts[counts == 0] = np.nan
        return sums / counts[:, None]


def gallery(class_name: str, images: Sequence[ImageKey], answers: NDArray[Any]) -> Gallery:
    """Return the gallery of a class, from the answers [n, 3 + d] to its n true images."""
    objects = tuple(sorted({obj for obj, _ in images}))
    codes = _codes(answers)
    place = {obj: i for i, obj in enumerate(objects)}
    member = np.array([place[obj] for obj, _ in images], np.int64)
    sums = np.zeros((len(objects), codes.shape[1]))
    np.add.at(sums, member, codes)
    counts = np.bincount(member, minlength=len(objects))
    return Gallery(class_name, objects, sums, counts, dict(zip(images, codes, strict=True)))


def why_no_retrieval(among: Gallery) -> str:
    """Return the reason why this gallery permits no retrieval; empty where it does."""
    if len(among.objects) < 2:
        return f"{len(among.objects)} object: there is nothing to tell it from; run at least 2"
    if among.counts.min() < 2:
        return "1 view an object: none is left to know it by; run at least 2"
    return ""


def found(among: Gallery, answers: NDArray[Any], images: Sequence[ImageKey]) -> Floats:
    """Return 1 for each image [n] whose judged code is nearest to the right object, else 0.

    The distance is Euclidean; of objects equally near the first by name counts.
    """
    from scipy.spatial.distance import cdist  # a moment to import, which most commands need not

    codes = _codes(answers)
    hits = np.zeros(len(images))
    views = np.array([view for _, view in images], np.int64)
    for view in np.unique(views).tolist():
        rows = np.flatnonzero(views == view).tolist()
        means = among.without(view)
        at_once = max(1, AT_ONCE // max(len(means), 1))
        for start in range(0, len(rows), at_once):
            some = rows[start : start + at_once]
            distances = cdist(codes[some], means)
            hits[some] = [
                among.objects[k] == images[i][0]
                for i, k in zip(some, distances.argmin(axis=1), strict=True)
            ]
    return hits


def _codes(answers: NDArray[Any]) -> Floats:
    return np.asarray(answers)[:, VIEW_COLUMNS:].astype(np.float64)
