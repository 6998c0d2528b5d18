"""How many chairs of a split have a structure that a training has seen.

    python -m studies.structure_seen [--train 1500,3000] [--chairs 24,100]

The structure of a chair is what of its description is neither a length, an angle nor a colour:
family, back, seat, base, legs, stretchers, arms, cushion, bars and so on. Prints a Markdown table.
Novel families have no such description; none of their structures is in a training.
"""

from __future__ import annotations

import argparse
from dataclasses import fields

from bench.suites.latent.chairs import specified_chairs
from data_prep.datasets.objects import Split
from data_prep.shapes.chair.spec import ChairSpec
from studies.arguments import numbers
from studies.tables import markdown

MEASURED: tuple[Split, ...] = ("validation", "test")
DISCRETE = tuple(field.name for field in fields(ChairSpec) if field.type not in ("float", "Color"))


def structure(spec: ChairSpec) -> tuple[object, ...]:
    """The discrete choices of a description."""
    return tuple(getattr(spec, name) for name in DISCRETE)


def seen(split: Split, chairs: int, train: int) -> int:
    """How many of the first chairs of a split share their structure with one of a training."""
    known = {structure(chair.spec) for chair in specified_chairs("train", train)}
    return sum(structure(chair.spec) in known for chair in specified_chairs(split, chairs))


def main() -> None:
    """Run the study from the command line."""
    parser = argparse.ArgumentParser(description="Structures of chairs that trainings have seen.")
    parser.add_argument("--train", type=numbers, default=(1500, 3000))
    parser.add_argument("--chairs", type=numbers, default=(24, 100))
    options = parser.parse_args()
    rows = [
        [f"{split}, {chairs} chairs", *(str(seen(split, chairs, train)) for train in options.train)]
        for split in MEASURED
        for chairs in options.chairs
    ]
    heads = [f"in {train} training chairs" for train in options.train]
    print(markdown(["split", *heads], rows), end="")


if __name__ == "__main__":
    main()
