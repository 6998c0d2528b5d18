"""How often a comparison decides a true difference as large as the resolution that it prints.

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
    """Simulated runs of one population.

    Attributes
    ----------
    share : float
        Runs that decide a difference as large as the resolution.
    printed : float64 [runs]
        Resolutions that the runs print, over that of the population.
    """

    share: float
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


def simulate(population: Floats, objects: int, runs: int, level: float, seed: int) -> Decided:
    """Return what runs of so many objects decide of a difference as large as the resolution."""
    rng = np.random.default_rng((seed, objects))
    true_error = StandardError(float(population.std()) / objects**0.5, objects - 1)
    resolution = detectable(true_error, level)
    moved = population - population.mean() + resolution
    drawn = rng.choice(moved, size=(runs, objects))
    share = float((sign_flip_p(drawn) < level).mean())
    printed = np.array([detectable(mean_error([values]), level) for values in drawn])
    return Decided(share, printed / resolution)


def lines(
    populations: Sequence[Floats], counts: Sequence[int], runs: int, cells: int
) -> list[list[str]]:
    """Return a line for each number of objects."""
    table = []
    for objects in counts:
        texts = [str(objects)]
        for level in (SIGNIFICANCE, SIGNIFICANCE / cells):
            decided = [simulate(p, objects, runs, level, i) for i, p in enumerate(populations)]
            shares = 100 * np.array([d.share for d in decided])
            texts.append(f"{shares.mean():.1f} ({shares.min():.0f} to {shares.max():.0f})")
        low, middle, high = np.nanpercentile(
            np.concatenate([d.printed for d in decided]), [5, 50, 95]
        )
        table.append([*texts, f"{middle:.2f} ({low:.2f} to {high:.2f})"])
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
