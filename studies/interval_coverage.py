"""How often the 95 % intervals of means hold the true mean, by simulation.

    python -m studies.interval_coverage > results/docs/interval-coverage.csv

Scores of single objects are drawn from distributions whose true means are known. For each
distribution and each number of objects many samples are drawn, and the share of samples is counted
whose interval (`bench.analysis.intervals`) holds the true mean. The last two distributions are
those of a method that fails on some objects: most scores lie close together, and a few are that of
a blank image.
"""

from __future__ import annotations

import csv
import math
import sys
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from bench.analysis.intervals import mean_interval
from data_prep.arrays import Floats
from data_prep.randomness import generator

OBJECTS = (8, 12, 24, 60, 100)  # sizes of samples
# Samples of each size from each distribution. A share of 95 % then has a standard error of 0.15 %.
SAMPLES = 20_000
USUAL, SPREAD = 0.9, 0.02  # mean and standard deviation of the scores of a method where it draws
OF_BLANK = 0.3  # the score of a blank image, where it fails

Draw = Callable[[np.random.Generator, tuple[int, int]], Floats]


class Shape(NamedTuple):
    """A distribution of scores.

    draw  returns random scores of a shape, [samples, objects]
    mean  the true mean
    """

    draw: Draw
    mean: float


def _failing(share: float) -> Shape:
    """Return the distribution of scores of a method that fails on a share of the objects, 0..1."""

    def draw(rng: np.random.Generator, size: tuple[int, int]) -> Floats:
        failed = rng.random(size) < share
        return np.where(failed, OF_BLANK, rng.normal(USUAL, SPREAD, size))

    return Shape(draw, share * OF_BLANK + (1 - share) * USUAL)


SHAPES: Mapping[str, Shape] = {
    "normal": Shape(lambda rng, size: rng.normal(0.0, 1.0, size), 0.0),
    "near-the-best": Shape(lambda rng, size: rng.beta(8, 1.2, size), 8 / 9.2),
    "near-the-worst": Shape(lambda rng, size: rng.beta(0.5, 2, size), 0.2),
    "exponential": Shape(lambda rng, size: rng.exponential(1.0, size), 1.0),
    "lognormal-0.5": Shape(lambda rng, size: rng.lognormal(0.0, 0.5, size), math.exp(0.125)),
    "lognormal-0.8": Shape(lambda rng, size: rng.lognormal(0.0, 0.8, size), math.exp(0.32)),
    "one-in-ten-fails": _failing(1 / 10),
    "one-in-twenty-fails": _failing(1 / 20),
}


def coverage(name: str, objects: int, samples: int = SAMPLES, seed: int = 0) -> float:
    """Return the share of samples whose interval holds the true mean, 0..1.

    name     of a distribution, a key of SHAPES
    objects  in a sample
    """
    shape = SHAPES[name]
    drawn = shape.draw(generator(seed, "interval coverage", name, objects), (samples, objects))
    held = 0
    for scores in drawn:
        low, high = mean_interval(scores)
        held += low <= shape.mean <= high
    return held / samples


def main() -> None:
    """Print the coverage of each shape at each number of objects as CSV."""
    lines = csv.writer(sys.stdout, lineterminator="\n")
    lines.writerow(("shape", "objects", "samples", "coverage"))
    for name in SHAPES:
        for objects in OBJECTS:
            lines.writerow((name, objects, SAMPLES, f"{coverage(name, objects):.3f}"))


if __name__ == "__main__":
    main()
