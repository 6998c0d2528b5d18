"""Precision between true images of different objects, and the number of neighbours it depends on.

    python -m studies.feature_neighbours DIR

Of the features of fd-alexnet of a finished run's true images: the share of nearest neighbours that
show the image's own object, and the precision of the images of one random half of the objects
against those of the other, the mean over 20 halvings. A perfect method that draws other objects has
no more than that. `bench.metrics.precision_recall` chooses its number of neighbours by it.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from bench.analysis.scored import read_scored
from bench.metrics.precision_recall import share_within
from bench.records.record import GROUND_TRUTH
from data_prep.arrays import Floats

EXTRACTOR = "fd-alexnet"
NEIGHBOURS = (3, 5, 10, 20)
HALVINGS = 20


class Neighbourhood(NamedTuple):
    """The share of the own object among k neighbours, and the precision between halves, 0 to 1."""

    k: int
    own_object: float
    between_halves: float


def neighbourhoods(
    features: Floats, objects: NDArray[Any], ks: Sequence[int] = NEIGHBOURS
) -> list[Neighbourhood]:
    """Return both shares for each k, of features [n, d] and the object of each row [n]."""
    distances = cdist(features, features)
    np.fill_diagonal(distances, np.inf)
    alike = objects[np.argsort(distances, axis=1)] == objects[:, None]
    names, rng = np.unique(objects), np.random.default_rng(0)
    halves = [np.isin(objects, rng.permutation(names)[::2]) for _ in range(HALVINGS)]
    return [
        Neighbourhood(
            k,
            float(alike[:, :k].mean()),
            float(np.mean([share_within(features[h], features[~h], k) for h in halves])),
        )
        for k in ks
    ]


def main() -> None:
    """Print a line for each number of neighbours."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("directory", type=Path)
    run = read_scored(parser.parse_args().directory)
    features = run.features[EXTRACTOR]
    images = features.images(GROUND_TRUTH, "", min(run.sums.objects_of))
    values = features.of(GROUND_TRUTH, "", min(run.sums.objects_of), images)
    for line in neighbourhoods(values.astype(np.float64), np.array([obj for obj, _ in images])):
        print(
            f"k {line.k:2}: own object {line.own_object:.3f}, "
            f"between halves {line.between_halves:.3f}"
        )


if __name__ == "__main__":
    main()
