"""The judge's answers: from where an image is seen, and which object it shows.

The functions take the answers of `bench.judges.judge.judge` as arrays and do not need the network.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_prep.arrays import Floats

ImageKey = tuple[str, int]  # the name of the object, and the number of the view
ELEVATION_UNIT_DEG = 40.0  # the unit of the judge's elevations, in degrees
AT_ONCE = 2**16  # the number of distances between codes that are in memory at a time
# The first columns of an answer: sine and cosine of the azimuth, and the elevation. The columns
# after them are the shape code.
VIEW_COLUMNS = 3


def azimuth_error_deg(answers: NDArray[Any], azimuth_deg: Floats) -> Floats:
    """Return the error of the judged azimuth against the requested one, [n], 0..180 degrees.

    answers      [n, 3 + d]
    azimuth_deg  [n], any finite value; azimuths that differ by 360 degrees are the same
    """
    sine, cosine = answers[:, 0].astype(float), answers[:, 1].astype(float)
    judged = np.degrees(np.arctan2(sine, cosine))
    return np.abs((judged - azimuth_deg + 180.0) % 360.0 - 180.0)


def elevation_error_deg(answers: NDArray[Any], elevation_deg: Floats) -> Floats:
    """Return the error of the judged elevation against the requested one, [n], in degrees."""
    return np.abs(ELEVATION_UNIT_DEG * answers[:, 2].astype(float) - elevation_deg)


@dataclass(frozen=True, eq=False)
class Gallery:
    """The shape codes of all true images of a class, to which codes of drawn images are compared.

    class_name  the class
    objects     the names of its G objects, sorted
    sums        float64 [G, d], the sum of the codes of each object's true images
    counts      int [G], the number of each object's true images
    codes       the code of each true image, float64 [d]
    """

    class_name: str
    objects: tuple[str, ...]
    sums: Floats
    counts: NDArray[np.int64]
    codes: dict[ImageKey, Floats]

    def without(self, view: int) -> Floats:
        """Return the mean code [G, d] of each object over its true images of all other views.

        So an image is never compared with the true image of its own view. It has to be recognised
        by its shape, and that also holds where true images are judged. NaN for an object that has
        no image of another view.
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
    """Return the gallery of a class, made of the answers [n, 3 + d] to its n true images."""
    objects = tuple(sorted({obj for obj, _ in images}))
    codes = _codes(answers)
    place = {obj: i for i, obj in enumerate(objects)}
    member = np.array([place[obj] for obj, _ in images], np.int64)
    sums = np.zeros((len(objects), codes.shape[1]))
    np.add.at(sums, member, codes)
    counts = np.bincount(member, minlength=len(objects))
    return Gallery(class_name, objects, sums, counts, dict(zip(images, codes, strict=True)))


def why_no_retrieval(among: Gallery) -> str:
    """Return the reason why no object can be looked up in this gallery; "" where one can."""
    if len(among.objects) < 2:
        return f"{len(among.objects)} object: there is nothing to tell it from; run at least 2"
    if among.counts.min() < 2:
        return "1 view an object: none is left to know it by; run at least 2"
    return ""


def found(among: Gallery, answers: NDArray[Any], images: Sequence[ImageKey]) -> Floats:
    """Return 1 for each image [n] whose code is nearer to its own object than to others, else 0.

    among    the gallery with the mean codes of the objects
    answers  [n, 3 + d], the answers to the images
    images   which object each image shows, and from which view

    The distance is Euclidean. Where several objects are equally near, the first by name counts.
    """
    # Imported here, because it takes a moment and most commands do not need it.
    from scipy.spatial.distance import cdist

    codes = _codes(answers)
    hits = np.zeros(len(images))
    views = np.array([view for _, view in images], np.int64)
    for view in np.unique(views).tolist():
        rows = np.flatnonzero(views == view).tolist()
        means = among.without(view)
        at_once = max(1, AT_ONCE // max(len(means), 1))
        for start in range(0, len(rows), at_once):
            some = rows[start : start + at_once]
            nearest = cdist(codes[some], means).argmin(axis=1)
            for row, place in zip(some, nearest, strict=True):
                own_object, _ = images[row]
                hits[row] = among.objects[place] == own_object
    return hits


def _codes(answers: NDArray[Any]) -> Floats:
    """Return the shape codes [n, d] in answers [n, 3 + d]."""
    return np.asarray(answers)[:, VIEW_COLUMNS:].astype(np.float64)
