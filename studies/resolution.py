"""The share of comparisons that decide a true difference as large as the resolution.

    python -m studies.resolution [--runs 200] [--counts 12,24,50,100] [--cells 20]

The populations are differences recorded by object: each competing method of the default run less
the best one of its cell, by the metrics of the headline (`results/golden`, 24 chairs). All values
of a population are moved so that their mean is the resolution of so many objects, by the
population's own spread. Each simulated run draws objects with replacement and decides as
`bench compare` does, by sign flips. Two levels: .05, of one comparison, and .05 over the number of
cells, the first step of Holm's procedure. A share of 80 % is expected.

The last column is the resolution that a run prints, which it takes from the spread of its own
objects, over that of the population: median, and from 5 % to 95 % of all runs.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from bench.analysis.intervals import StandardError, mean_error
from bench.analysis.paired import SIGNIFICANCE, sign_flip_p
from bench.analysis.resolution import detectable
from bench.catalogue.methods import role
from bench.catalogue.metrics import higher_is_better
from bench.catalogue.suites import ROBUSTNESS
from bench.checking.objects import ANY, read_objects
from data_prep.arrays import Floats
from data_prep.failures import BadInput
from studies.arguments import numbers, positive
from studies.tables import markdown


class Decided(NamedTuple):
    """Simulated runs of populations.

    Attributes
    ----------
    shares : float64 [populations]
        Runs of a population that decide a difference as large as the resolution.
    printed : float64 [populations, runs]
        Resolutions that the runs print, over that of the population.
    """

    shares: Floats
    printed: Floats


def recorded() -> list[Floats]:
    """Return the differences [objects] of each method to the best one of its cell.

    Pairs without any difference are left out. Raises BadInput without golden values.
    """
    golden = read_objects(ROBUSTNESS.id)
    if golden is None:
        raise BadInput(f"results/golden: no values by object of {ROBUSTNESS.id}; restore them")
    populations = []
    lines = golden.lines[golden.lines["condition"] != ANY]  # of methods that see a cloud
    for metric in ROBUSTNESS.headline:
        sign = 1.0 if higher_is_better(metric) else -1.0
        for _, cell in lines.groupby("condition", sort=False):
            by_method = sign * cell.pivot(index="object", columns="method", values=metric)
            competing = by_method[[name for name in by_method if not role(str(name))]].dropna(
                axis=1
            )
            best = competing[competing.mean().idxmax()]
            differences = (competing[name] - best for name in competing)
            populations += [d.to_numpy() for d in differences if d.std() > 0]
    return populations


def simulate(
    populations: Sequence[Floats], objects: int, runs: int, level: float, seed: int = 0
) -> Decided:
    """Return what runs of so many objects decide of differences as large as the resolution."""
    rng = np.random.default_rng((seed, objects))
    errors = [StandardError(float(p.std()) / objects**0.5, objects - 1) for p in populations]
    resolutions = np.array([detectable(error, level) for error in errors])
    drawn = np.array(
        [
            rng.choice(values - values.mean() + least, size=(runs, objects))
            for values, least in zip(populations, resolutions, strict=True)
        ],
        np.float64,
    )
    shares = (sign_flip_p(drawn) < level).mean(axis=1)  # the same signs for all: faster
    printed = [[detectable(mean_error([row]), level) for row in rows] for rows in drawn]
    return Decided(shares, np.array(printed) / resolutions[:, None])


def lines(
    populations: Sequence[Floats], counts: Sequence[int], runs: int, cells: int
) -> list[list[str]]:
    """Return a line for each number of objects."""
    table = []
    for objects in counts:
        alone, among = (
            simulate(populations, objects, runs, level)
            for level in (SIGNIFICANCE, SIGNIFICANCE / cells)
        )
        percent = (100 * decided.shares for decided in (alone, among))
        texts = [f"{p.mean():.1f} ({p.min():.0f} to {p.max():.0f})" for p in percent]
        low, middle, high = np.nanpercentile(alone.printed, [5, 50, 95])
        table.append([str(objects), *texts, f"{middle:.2f} ({low:.2f} to {high:.2f})"])
    return table


def main() -> None:
    """Run the study from the command line."""
    parser = argparse.ArgumentParser(description="Share of runs that decide the resolution.")
    parser.add_argument("--runs", type=positive, default=200)
    parser.add_argument("--counts", type=numbers, default=(12, 24, 50, 100))
    parser.add_argument("--cells", type=positive, default=20)
    options = parser.parse_args()
    populations = recorded()
    print(f"{len(populations)} populations, {options.runs} runs of each\n")
    head = ["objects", "decided at .05, %", f"at .05/{options.cells}, %", "printed, relative"]
    print(markdown(head, lines(populations, options.counts, options.runs, options.cells)), end="")


if __name__ == "__main__":
    main()
