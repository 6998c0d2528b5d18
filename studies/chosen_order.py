"""The order of the methods that learn nothing at each condition, for `results/chosen.csv`.

    bench run --suite thirteen-classes --dataset procedural:validation --methods ... --out DIR
    python -m studies.chosen_order DIR...

Of runs on validation objects: the mean of a method's ranks by the headline metrics, of their means
over classes, with a blank image for each failed one; of equal methods the one with the lower LPIPS
is first. Prints the methods of each condition, the best first, with their values.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import pandas as pd

from bench.analysis.paper import AVERAGE
from bench.catalogue.methods import FLOORS
from studies.metric_agreement import read_values

METRICS = ["ssim-object", "lpips"]  # read with a sign so that more is better


def in_order(values: pd.DataFrame) -> pd.DataFrame:
    """Return the methods of one condition, the best first, with a column for their mean rank.

    values  a line for each method, a column for each of METRICS; more is better
    """
    ranks = values[METRICS].rank(ascending=False).mean(axis=1)
    ordered = values.assign(rank=ranks, worse=-values["lpips"]).sort_values(["rank", "worse"])
    return ordered[["rank", *METRICS]]


def main() -> None:
    """Read runs from the command line."""
    parser = argparse.ArgumentParser(description="The best that learn nothing, by condition.")
    parser.add_argument("directories", type=Path, nargs="+")
    for directory in parser.parse_args().directories:
        values = pd.DataFrame(read_values(directory).xs(AVERAGE, level="class"))
        values = values.drop(list(FLOORS), level="method", errors="ignore")
        for condition, cell in values.groupby("condition", sort=False):
            ordered = in_order(cell.reset_index("condition", drop=True))
            print(f"{condition},{' '.join(map(str, ordered.index))}")
            print(ordered.round(4).T.to_string(), end="\n\n")


if __name__ == "__main__":
    main()
