"""The rate of false verdicts of runs that are looked at after each object, and when they decide.

    python -m studies.sequence_coverage DIR [--runs 2000] [--objects 100] [--methods A,B]
        [--without 24] [--counts 8,24,100,1000]

First table: simulated runs. The objects of a finished run in DIR are drawn with replacement, all
their differences together, and `bench.analysis.decided` looks after each. A verdict is false where
the mean of the population (its differences within bounds) says otherwise: ahead of a mean of 0 or
less, behind of 0 or more, equal of more than EQUAL. The populations are those recorded, and the
same moved so that all means are 0, or just beyond EQUAL: there a false verdict is easiest. Beside
them: how often t intervals would have told means of 0 from 0 at any of these looks.

Second table: the rate at which a sequence at 95 % has left out the true mean by n objects, for
distributions of known mean within bounds of 0.5.

Everything is computed for the few means that matter, run by run at once; tests compare it with the
sequences of the tables. A minute on one thread.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from bench.analysis.decided import BOUNDS, EQUAL, HeadlinePair, headline_pairs
from bench.analysis.paired import SIGNIFICANCE
from bench.analysis.scored import read_scored
from bench.analysis.sequences import SHARES, WEIGHTS
from bench.catalogue.metrics import higher_is_better
from data_prep.arrays import Floats
from studies.arguments import names, numbers, positive
from studies.tables import markdown

NEVER = np.iinfo(np.int64).max
FEWEST = 8  # objects with an interval in the tables
BEYOND = EQUAL + 0.0005
BOUND = 0.5  # of the second table

Drawn = Callable[[np.random.Generator, tuple[int, int]], Floats]
# Distributions within BOUND with their means.
CLOSED: Mapping[str, tuple[Drawn, float]] = {
    "uniform": (lambda rng, size: rng.uniform(-0.5, 0.5, size), 0.0),
    "normal, sd 0.1": (lambda rng, size: rng.normal(0, 0.1, size).clip(-0.5, 0.5), 0.0),
    "exponential, mean 0.1": (
        lambda rng, size: rng.exponential(0.1, size).clip(max=0.5),
        0.1 * (1 - math.exp(-5)),
    ),
    "one in 20 far off": (lambda rng, size: np.where(rng.random(size) < 0.05, 0.475, -0.025), 0.0),
    "two values": (lambda rng, size: rng.choice([-0.5, 0.5], size), 0.0),
}


class Decisions(NamedTuple):
    """Numbers of objects, [runs] each, after which something is shown; NEVER where it is not."""

    ahead: NDArray[np.int64]
    behind: NDArray[np.int64]
    equal: NDArray[np.int64]


def first_reached(values: Floats, mean: float, bound: float, limit: float) -> NDArray[np.int64]:
    """Return after how many of the values [runs, n] a mean is shown to be above `mean`, [runs]."""
    odds = (values + bound) / (mean + bound)
    total = np.zeros(values.shape)
    for share, weight in zip(SHARES, WEIGHTS, strict=True):
        total += weight * np.exp(np.log1p(share * (odds - 1)).cumsum(axis=1))
    reached = total >= math.exp(limit)
    return np.where(reached.any(axis=1), reached.argmax(axis=1) + 1, NEVER)


def decisions(values: Floats, bound: float, alpha: float) -> Decisions:
    """Return when differences within bounds [runs, n] are decided, looked at after each."""
    limit = math.log(2 / alpha)
    above, below = (first_reached(side, -EQUAL, bound, limit) for side in (values, -values))
    return Decisions(
        first_reached(values, 0.0, bound, limit),
        first_reached(-values, 0.0, bound, limit),
        np.maximum(above, below),
    )


def moved(values: Floats, mean: float, bound: float) -> Floats:
    """Return differences [n], moved and within bounds, whose mean is `mean`."""
    low, high = -2 * bound, 2 * bound
    for _ in range(60):
        middle = (low + high) / 2
        if (values + middle).clip(-bound, bound).mean() < mean:
            low = middle
        else:
            high = middle
    return (values + low).clip(-bound, bound)


def recorded(directory: Path, methods: Sequence[str] | None) -> dict[HeadlinePair, Floats]:
    """Return the differences of the headline pairs of a run, above 0 where the method is ahead."""
    run = read_scored(directory)
    metrics = run.measured(run.suite.headline)
    conditions = run.manifest["conditions"]
    pairs = headline_pairs(run.suite, run.manifest["methods"], conditions, metrics)
    compared = {comparison.condition: comparison for comparison in run.compared(metrics)}
    differences = {}
    for pair in pairs:
        if methods is None or pair.method in methods:
            qualities = compared[pair.condition].qualities[pair.metric]
            sign = 1.0 if higher_is_better(pair.metric) else -1.0
            both = qualities[pair.method].per_object, qualities[pair.opponent].per_object
            differences[pair] = sign * (both[0] - both[1])
    return differences


def false_verdicts(verdicts: Decisions, mean: float) -> NDArray[np.bool_]:
    """Return in which runs the verdict on a pair is false, given the mean of its population."""
    first = np.min(verdicts, axis=0)
    decided = first < NEVER
    # What is shown first is the verdict; equal where both come at once.
    is_equal = decided & (verdicts.equal == first)
    is_ahead, is_behind = (
        decided & ~is_equal & (side == first) for side in (verdicts.ahead, verdicts.behind)
    )
    rounding = 1e-9  # of a mean that was moved to 0
    false = is_equal & (abs(mean) > EQUAL)
    false |= is_ahead & (mean <= rounding)
    return false | is_behind & (mean >= -rounding)


class Simulated(NamedTuple):
    """Simulated runs.

    false    share of the runs with a false verdict on any pair
    used     objects until all pairs are decided, [runs]; all objects where one stays open
    of_pair  objects until a pair is decided, [pairs, runs]
    by_t     share of the runs in which a t interval has ever left out a mean of 0; NaN for others
    """

    false: float
    used: NDArray[np.int64]
    of_pair: NDArray[np.int64]
    by_t: float


def simulate(
    differences: Mapping[HeadlinePair, Floats], runs: int, objects: int, seed: int
) -> Simulated:
    """Return what runs of so many objects decide, drawn from differences within bounds."""
    rng = np.random.default_rng(seed)
    count = len(next(iter(differences.values())))
    drawn = rng.integers(count, size=(runs, objects))
    false, by_t = np.zeros(runs, bool), np.zeros(runs, bool)
    of_pair = []
    for pair, values in differences.items():
        alpha = SIGNIFICANCE / len(differences)
        verdicts = decisions(values[drawn], BOUNDS[pair.metric], alpha)
        false |= false_verdicts(verdicts, float(values.mean()))
        by_t |= ever_missed_by_t(values[drawn], 0.0, alpha)
        of_pair.append(np.minimum(np.min(verdicts, axis=0), objects))
    used = np.max(of_pair, axis=0)
    is_null = all(abs(values.mean()) < 1e-9 for values in differences.values())
    return Simulated(
        float(false.mean()),
        used,
        np.array(of_pair),
        float(by_t.mean()) if is_null else math.nan,
    )


def ever_missed_by_t(values: Floats, mean: float, alpha: float) -> NDArray[np.bool_]:
    """Return in which of the runs [runs, n] a t interval of FEWEST or more misses, [runs]."""
    n = np.arange(1, values.shape[1] + 1)
    means = values.cumsum(axis=1) / n
    squares = (values**2).cumsum(axis=1) / n - means**2
    part = slice(FEWEST - 1, None)
    error = np.sqrt(squares[:, part].clip(0) / (n[part] - 1))
    reach = stdtrit(n[part] - 1, 1 - alpha / 2) * error
    return (np.abs(means[:, part] - mean) > reach + 1e-12).any(axis=1)


def coverage(name: str, n: int, runs: int) -> tuple[float, float]:
    """Return the rates at which a sequence and t intervals have left out the mean by n objects."""
    draw, mean = CLOSED[name]
    values = draw(np.random.default_rng(n), (runs, n))
    limit = math.log(2 / 0.05)
    above = first_reached(values, mean, BOUND, limit) < NEVER
    below = first_reached(-values, -mean, BOUND, limit) < NEVER
    return float((above | below).mean()), float(ever_missed_by_t(values, mean, 0.05).mean())


def main() -> None:
    """Run the study from the command line."""
    parser = argparse.ArgumentParser(description="False verdicts of runs that end when decided.")
    parser.add_argument("directory", type=Path)
    parser.add_argument("--runs", type=positive, default=2000)
    parser.add_argument("--objects", type=positive, default=100)
    parser.add_argument("--methods", type=names)
    parser.add_argument("--without", type=int, default=0, help="leave out the first objects")
    parser.add_argument("--counts", type=numbers, default=(8, 24, 100, 1000))
    options = parser.parse_args()
    every = recorded(options.directory, options.methods)
    differences_of = {pair: values[options.without :] for pair, values in every.items()}
    within = {p: v.clip(-BOUNDS[p.metric], BOUNDS[p.metric]) for p, v in differences_of.items()}
    populations = {"as recorded": within}
    for title, mean in (("all means 0", 0.0), (f"all means {BEYOND:g}", BEYOND)):
        populations[title] = {p: moved(v, mean, BOUNDS[p.metric]) for p, v in within.items()}
    lines = []
    for seed, (title, differences) in enumerate(populations.items()):
        simulated = simulate(differences, options.runs, options.objects, seed)
        median = np.median(simulated.of_pair / options.objects)
        by_t = "" if math.isnan(simulated.by_t) else f"{100 * simulated.by_t:.1f}"
        numbers_ = (
            f"{100 * simulated.false:.2f}",
            by_t,
            f"{np.median(simulated.used):.0f}",
            f"{median:.2f}",
        )
        lines.append([title, *numbers_, f"{(simulated.of_pair < options.objects).mean():.2f}"])
    turned = sum(
        np.sign(differences_of[p].mean()) != np.sign(within[p].mean()) for p in differences_of
    )
    count = len(next(iter(differences_of.values())))
    size = f"{len(differences_of)} pairs, {count} objects recorded"
    print(f"{size}, {options.runs} runs of {options.objects}")
    print(f"bounds turn the sign of {turned} pairs\n")
    head = ["population", "runs with a false verdict, %", "by t intervals, %", "objects, median"]
    print(markdown([*head, "share of objects of a pair, median", "pairs decided"], lines))
    lines = [
        [
            name,
            *(
                "{:.1f} ({:.1f})".format(*(100 * rate for rate in coverage(name, n, options.runs)))
                for n in options.counts
            ),
        ]
        for name in CLOSED
    ]
    print(
        markdown(["left out by n objects, % (t intervals)", *map(str, options.counts)], lines),
        end="",
    )


if __name__ == "__main__":
    main()
