"""The time that `auto` takes to choose a method for a cloud.

    OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 python -m studies.auto_overhead [--rounds 100]

On clouds of the first validation object of each class: the median over rounds and objects of the
estimate of noise and spacing, and of the choice by the table, on one thread.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from statistics import median

from bench.catalogue.auto_renderer import estimate_of
from bench.catalogue.auto_table import TABLE
from data_prep.clouds.sampling import sample_surface
from data_prep.datasets.registry import open_dataset
from data_prep.randomness import generator
from studies.arguments import positive
from studies.tables import markdown

COUNTS = (256, 2048, 20000, 200000)


def milliseconds_of(work: Callable[[], object], rounds: int) -> float:
    """Return the median time of a call."""
    times = []
    for _ in range(rounds):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return 1000 * median(times)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description="What choosing a method takes.")
    parser.add_argument("--rounds", type=positive, default=100)
    rounds = parser.parse_args().rounds
    dataset = open_dataset("procedural:validation")
    meshes = [dataset.objects(name, 1, 1)[0].load() for name in dataset.classes]
    rows = []
    for count in COUNTS:
        clouds = [sample_surface(mesh, generator("overhead"), count) for mesh in meshes]
        estimates = [milliseconds_of(lambda c=c: estimate_of(c), rounds) for c in clouds]
        known = estimate_of(clouds[0])
        choice = milliseconds_of(lambda known=known: TABLE.choose(known, None), rounds)
        rows.append((f"{count}", f"{median(estimates):.2f}", f"{choice:.3f}"))
    print(markdown(["points", "estimate, ms", "choice, ms"], rows))


if __name__ == "__main__":
    main()
