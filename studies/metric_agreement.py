"""Agreement of the metrics of a run about the order of its methods.

    bench score DIR --metrics ms-ssim,flip,dists,st-lpips
    python -m studies.metric_agreement DIR [--metrics ssim,lpips] [-o metric-agreement.csv]

Of all tables of a finished run, those of `bench score` included: Kendall's rank correlation (tau-b)
of each pair of metrics at each condition, over the methods that compete and the floors. The true
meshes are left out, which every metric puts first. Values are means with a blank image for each
failed one, signed so that more is better, and rounded as tables print them, so that what differs by
less is a tie. A pair is left out where one metric has no value for a method, or the same for all.

Prints a matrix for each condition, and writes all pairs with the number of methods.
"""

from __future__ import annotations

import argparse
import csv
from collections.abc import Sequence
from pathlib import Path

import pandas as pd
from scipy.stats import kendalltau

from bench.analysis.digits import decimals
from bench.catalogue.chosen import CHOSEN
from bench.catalogue.conditions import condition_words
from bench.catalogue.methods import role
from bench.catalogue.metrics import higher_is_better
from bench.tables.table import TABLES
from data_prep.failures import BadInput
from data_prep.files.atomic_write import write_whole
from studies.tables import markdown

FIELDS = {"method", "condition", "class", "metric", "failures_as_blank"}
METRICS = (
    *("ssim", "ssim-object", "lpips", "ms-ssim", "flip"),
    *("dists", "st-lpips", "silhouette-iou", "fd-views", "fd-alexnet"),
)


def read_values(directory: Path) -> pd.DataFrame:
    """Return the values of a run's tables, more is better, by condition, class, method and metric.

    The result has a line for each of the first three and a column for each metric. Raises BadInput
    for a folder without tables.
    """
    files = sorted((directory / TABLES).glob("*.csv"))
    tables = [pd.read_csv(file, dtype={"condition": str}) for file in files]
    tables = [table for table in tables if {*table.columns} >= FIELDS]
    if not tables:
        raise BadInput(f"{directory}: no tables; start the run again with its command")
    rows = pd.concat(tables).drop_duplicates(["condition", "class", "method", "metric"])
    competing = rows["method"].map(role).isin(["", "floor"])
    rows = rows[competing & (~rows["method"].isin(CHOSEN))]
    pairs = zip(map(str, rows["metric"]), rows["failures_as_blank"], strict=True)
    signed = [
        round(value, decimals(metric)) * (1 if higher_is_better(metric) else -1)
        for metric, value in pairs
    ]
    rows = rows.assign(value=signed)
    keys = ["condition", "class", "method"]
    values = rows.pivot(index=keys, columns="metric", values="value")
    return values.reindex(pd.MultiIndex.from_frame(rows[keys].drop_duplicates()))  # as in the files


def agreement(values: pd.DataFrame, metrics: Sequence[str]) -> list[dict[str, object]]:
    """Return tau of each pair of metrics among these, a row each, at each condition and class.

    values  of `read_values`; metrics that it does not have are left out
    """
    present = [metric for metric in metrics if metric in values]
    rows: list[dict[str, object]] = []
    for (condition, class_name), cell in values.groupby(["condition", "class"], sort=False):  # type: ignore[misc]
        for metric in present:
            for other in present:
                pair = cell[[metric, other]] if metric != other else cell[[metric]]
                if metric == other or pair.isna().to_numpy().any() or (pair.nunique() < 2).any():
                    continue
                tau = float(kendalltau(pair[metric], pair[other]).statistic)
                row = {"condition": condition, "class": class_name, "metric": metric}
                rows.append(row | {"other": other, "methods": len(pair), "tau": round(tau, 3)})
    return rows


def main() -> None:
    """Read a run from the command line."""
    parser = argparse.ArgumentParser(description="Where the metrics of a run agree.")
    parser.add_argument("directory", type=Path)
    parser.add_argument("--metrics", default=",".join(METRICS))
    parser.add_argument("-o", "--out", type=Path, default=Path("metric-agreement.csv"))
    options = parser.parse_args()
    pairs = pd.DataFrame(agreement(read_values(options.directory), options.metrics.split(",")))
    for (condition, class_name), cell in pairs.groupby(["condition", "class"], sort=False):  # type: ignore[misc]
        names = list(dict.fromkeys(cell["metric"]))
        taus = cell.pivot(index="metric", columns="other", values="tau")
        where = f"{class_name}, {condition_words(str(condition))}"
        print(f"\n{where}, {cell['methods'].iloc[0]} methods\n")
        body = [[a, *("" if a == b else f"{taus.loc[a, b]:.2f}" for b in names)] for a in names]
        print(markdown(["", *names], body), end="")
    text = pairs.to_csv(index=False, quoting=csv.QUOTE_MINIMAL, lineterminator="\n")
    write_whole(options.out, text.encode())


if __name__ == "__main__":
    main()
