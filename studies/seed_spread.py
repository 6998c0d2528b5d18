"""The spread of scores between trainings of one network that differ only in their seeds.

    bench run --suite chair-robustness --methods pc2pix,pc2pix@1.safetensors,pc2pix@2.safetensors
    bench table DIR --format csv > values.csv
    python -m studies.seed_spread values.csv \
        pc2pix=pc2pix@1.safetensors,pc2pix@2.safetensors > results/seeds.csv

The first argument is the file of values. Each further one names a bundled network, and the weights
of its other trainings. The output is CSV with a line for each network, metric and condition: the
number of trainings, the lowest and the highest value, their difference rounded as tables round
values, and the checksum of the bundled weights. Claims take smaller differences between methods for
a tie.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import pandas as pd

from bench.analysis.digits import decimals
from bench.catalogue.methods import find_method
from data_prep.files.checksums import file_sha256

METRICS = (
    "ssim",
    "luminance",
    "contrast",
    "structure",
    "lpips",
    "fd-views",
    "fd-alexnet",
    "thin-recall",
    "thin-precision",
)


def spreads(values: pd.DataFrame, trainings: Mapping[str, Sequence[str]]) -> pd.DataFrame:
    """Return the rows of the output, without checksums.

    values     with the columns method, condition, metric and value of `bench table --format csv`
    trainings  for each network, the methods of all its trainings, its own included

    Raises ValueError where a training lacks a value that another one has.
    """
    rows = []
    for network, methods in trainings.items():
        chosen = values[values["method"].isin(methods) & values["metric"].isin(METRICS)]
        for (metric, condition), group in chosen.groupby(["metric", "condition"], sort=False):
            if sorted(group["method"]) != sorted(methods):
                raise ValueError(
                    f"{metric} at {condition}: there are values of {list(group['method'])} only, "
                    f"not of all of {list(methods)}; run them all in one folder"
                )
            low, high = group["value"].min(), group["value"].max()
            spread = round(high - low, decimals(str(metric)))
            rows.append((network, metric, condition, len(group), low, high, spread))
    names = ["network", "metric", "condition", "trainings", "lowest", "highest", "spread"]
    return pd.DataFrame(rows, columns=names)


def main() -> None:
    """Run the study from the command line."""
    parser = argparse.ArgumentParser(description="Spread between trainings.")
    parser.add_argument("values", type=Path)
    parser.add_argument("trainings", nargs="+", metavar="NETWORK=METHOD,METHOD")
    options = parser.parse_args()
    asked = {}
    for text in options.trainings:
        network, _, others = text.partition("=")
        asked[network] = (network, *others.split(","))
    values = pd.read_csv(options.values, dtype={"condition": str})
    spread_table = spreads(values, asked)
    weights = {}
    for network in asked:
        file = find_method(network).weights_file
        assert file is not None, f"{network} has no weights"
        weights[network] = file_sha256(file())
    spread_table["weights_sha256"] = spread_table["network"].map(weights)
    spread_table.to_csv(sys.stdout, index=False, float_format="%.6g", lineterminator="\n")


if __name__ == "__main__":
    main()
