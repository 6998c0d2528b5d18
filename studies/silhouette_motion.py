"""The motion of silhouettes between views: distances, flicker, and their percentiles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from bench.analysis.intervals import RESAMPLES, SEED
from bench.metrics.silhouette import Masks, Pairs, boundary, open_sides
from data_prep.scene import UInt8Images

ASKED_PX = 2.0
PERCENTILES = (50, 95, 99)
WITHIN = f"within-{ASKED_PX:g}px"
STATISTICS = (*(f"p{q}" for q in PERCENTILES), WITHIN)


@dataclass(frozen=True, eq=False)
class Tally:
    """The values [D] of one object's boundary pixels, rising, and how often each occurs [D].

    Values are kept to a thousandth of a pixel: they are few then, whatever the number of views.
    """

    values: NDArray[np.float64]
    counts: NDArray[np.int64]

    @staticmethod
    def of(values: NDArray[np.float64]) -> Tally:
        """Return the tally of values in any order."""
        return Tally(*np.unique(np.round(values, 3), return_counts=True))


def silhouettes(truth: UInt8Images, images: UInt8Images) -> tuple[Masks, Masks]:
    """Return the silhouettes of true images and of images of the same objects, [N, H, W] each."""
    pairs = Pairs(truth, images)
    return pairs.shown, pairs.drawn(pairs.shown)


def offsets(masks: Masks) -> NDArray[np.float64]:
    """Return every pixel's signed distance from its mask's boundary, [N, H, W], positive inside.

    The boundary's own pixels have 0, those beside them outside -1. -inf for an empty mask.
    """
    signed = np.full(masks.shape, -np.inf)
    for field, mask, around in zip(signed, masks, boundary(masks), strict=True):
        if mask.any():
            field[:] = np.where(mask, 1.0, -1.0) * distance_transform_edt(~around)
    return signed


def distances(true: Masks, seen: Masks) -> NDArray[np.float64]:
    """Return each boundary pixel's distance to the other silhouette's boundary, views pooled.

    Distances from drawn to true follow those from true to drawn. They are infinite where the other
    of two silhouettes [N, H, W] is empty; where both are, there is no value.
    """
    return np.concatenate(
        [
            np.abs(offsets(other)[boundary(subject)])
            for subject, other in ((true, seen), (seen, true))
        ]
    )


def flicker(true: Masks, seen: Masks) -> NDArray[np.float64]:
    """Return the change of the offset at each boundary pixel from a view to the next, pooled.

    The views are a full turn: the first follows on the last. The offset of a pixel is compared with
    that of the nearest boundary pixel of the next view that is open to the same side. Infinite
    where one of the four silhouettes compared is empty.
    """
    changes = [np.empty(0)]
    for subject, other in ((true, seen), (seen, true)):
        offset = offsets(other)
        for side in open_sides(subject):
            for i in range(len(subject)):
                after = (i + 1) % len(subject)
                changes.append(change(side[i], side[after], offset[i], offset[after]))
    return np.concatenate(changes)


def change(
    here: NDArray[np.bool_],
    next_here: NDArray[np.bool_],
    before: NDArray[np.float64],
    after: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return how much `before` differs from `after` at the nearest pixel of `next_here`.

    All are [H, W]; the result has a value for each pixel of `here`. It is infinite where
    `next_here` is empty, and where one of the two is not finite.
    """
    if not here.any() or not next_here.any():
        return np.full(np.count_nonzero(here), np.inf)
    nearest = distance_transform_edt(~next_here, return_distances=False, return_indices=True)
    assert isinstance(nearest, np.ndarray)
    rows, columns = nearest[:, here]
    with np.errstate(invalid="ignore"):  # both infinite
        changed = np.abs(before[here] - after[rows, columns])
    return np.where(np.isnan(changed), np.inf, changed)


def estimates(tallies: Sequence[Tally]) -> NDArray[np.float64]:
    """Return value, low and high end of the interval [3] of each of STATISTICS: [3, S].

    The ends are NaN for fewer than 2 objects. Resamples depend on the number of objects alone.
    """
    values, member = np.unique(
        np.concatenate([tally.values for tally in tallies]), return_inverse=True
    )
    counts = np.zeros((len(tallies), len(values)), np.int64)
    which = np.repeat(np.arange(len(tallies)), [len(tally.values) for tally in tallies])
    counts[which, member] = np.concatenate([tally.counts for tally in tallies])
    point = statistics(values, counts.sum(axis=0))
    if len(tallies) < 2:
        return np.stack([point, np.full_like(point, np.nan), np.full_like(point, np.nan)])
    rng = np.random.default_rng(SEED)
    # How often each object is drawn in a resample.
    times = rng.multinomial(len(tallies), np.full(len(tallies), 1 / len(tallies)), RESAMPLES)
    resampled = np.stack([statistics(values, sample_counts @ counts) for sample_counts in times])
    # A value that was attained, not one between two: they may be infinite.
    ends = np.percentile(resampled, [2.5, 97.5], axis=0, method="inverted_cdf")
    return np.concatenate([point[None], ends])


def statistics(values: NDArray[np.float64], counts: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return STATISTICS of values [D], rising, that occur so often [D]; NaN of none."""
    until = counts.cumsum()
    if not until[-1:].any():
        return np.full(len(STATISTICS), np.nan)
    places = np.searchsorted(100 * until, np.array(PERCENTILES) * until[-1])
    return np.append(values[places], counts[values <= ASKED_PX].sum() / until[-1])
