"""The error of Fréchet distances of few objects, raw and debiased, against all objects of a run.

    python -m studies.frechet_error DIR [--objects 6,24,100] [--samples 20]

DIR is a run with many objects, 400 say. Of each of its cells (method and condition) random samples
of objects are taken, and their distances compared with the reference: the debiased distance of all
objects, whose raw one is shown beside it. Prints a Markdown table a feature extractor: the mean
error (bias) and the root mean square error over cells and samples, as shares of the reference.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.analysis import intervals
from bench.metrics.frechet import LeftOut, centred_to_frechet, left_out_distances
from bench.records.record import GROUND_TRUTH
from bench.tables.scored import ScoredRun, read_scored
from studies.arguments import numbers, positive
from studies.tables import markdown

EXTRACTORS = ("fd-views", "fd-alexnet")


class Sets(NamedTuple):
    """The features of one cell [n, d], of the true images of the same views, and their objects."""

    drawn: NDArray[Any]
    true: NDArray[Any]
    objects: NDArray[Any]


def estimates(sets: Sets, chosen: NDArray[Any]) -> tuple[float, float]:
    """The distance, raw and debiased, over the chosen objects alone."""
    keep = np.isin(sets.objects, chosen)
    sides = [LeftOut(of[keep], sets.objects[keep]) for of in (sets.drawn, sets.true)]
    raw = centred_to_frechet(sides[0].whole, sides[1].whole)
    return raw, intervals.debiased(raw, left_out_distances(*sides))


def errors(sets: Sets, count: int, samples: int, reference: float) -> NDArray[np.float64]:
    """Of random samples of that many objects [samples, 2]: raw and debiased over reference - 1."""
    rng = np.random.default_rng(count)
    names = np.unique(sets.objects)
    found = [estimates(sets, rng.choice(names, count, replace=False)) for _ in range(samples)]
    return np.array(found) / reference - 1


def cells(run: ScoredRun, extractor: str) -> Iterator[tuple[str, Sets]]:
    """Every method and condition that has images."""
    features = run.features[extractor]
    named = run.records[["method", "condition", "class"]].drop_duplicates()
    for method, condition, name in named.itertuples(index=False):
        images = [] if method == GROUND_TRUTH else features.images(method, condition, name)
        if images:
            drawn = features.of(method, condition, name, images)
            true = features.of(GROUND_TRUTH, "", name, images)
            yield f"{method}, {condition}", Sets(drawn, true, np.array([obj for obj, _ in images]))


def main() -> None:
    """Run the study from the command line."""
    parser = argparse.ArgumentParser(description="Errors of Fréchet distances of few objects.")
    parser.add_argument("directory", type=Path)
    parser.add_argument("--objects", type=numbers, default=(6, 24, 100))
    parser.add_argument("--samples", type=positive, default=20)
    options = parser.parse_args()
    intervals.FEWEST = 2  # tables debias nothing of fewer than 8 objects
    run = read_scored(options.directory)
    for extractor in EXTRACTORS:
        found: dict[int, list[NDArray[np.float64]]] = {count: [] for count in options.objects}
        for name, sets in cells(run, extractor):
            raw, reference = estimates(sets, np.unique(sets.objects))
            print(f"{extractor}, {name}: reference {reference:.3f}, raw {raw:.3f}", flush=True)
            for count, of in found.items():
                of.append(errors(sets, count, options.samples, reference))
        rows = []
        for count, of in found.items():
            both = np.concatenate(of)
            bias, rms = 100 * both.mean(axis=0), 100 * np.sqrt((both**2).mean(axis=0))
            shown = [f"{bias[k]:+.0f} ({rms[k]:.0f})" for k in range(2)]
            rows.append([str(count), *shown])
        print(f"\n{extractor}: bias and, in brackets, root mean square error, percent\n")
        print(markdown(["objects", "raw", "debiased"], rows), flush=True)


if __name__ == "__main__":
    main()
