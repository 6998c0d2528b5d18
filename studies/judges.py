"""Where the metrics of a run agree about methods, and where they do not.

    python -m studies.judges results/runs/chair-robustness-procedural [-o judges.png]

Of a finished run, the methods that compete and the floors:

1. Their order by each metric at each condition.
2. Spearman's rank correlation between metrics, over all methods and conditions, by values whose
   sign is that of "better".
3. A sheet: pairs of images of the same view that SSIM and LPIPS order the other way round, those
   with the largest product of both differences, an object and a pair of methods once each.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping
from itertools import combinations
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd
from scipy.stats import spearmanr

from bench.catalogue.methods import role
from bench.catalogue.metrics import higher_is_better
from bench.records.artifacts import Item
from bench.records.parquet import artifacts_of, read_jobs
from bench.rendering.files import write_images
from bench.rendering.sheet import Tile, draw_sheet
from bench.tables.build import tables
from bench.tables.quality import Row
from bench.tables.scored import read_scored
from studies.tables import markdown

PAIRS = 6  # on the sheet


class Disagreement(NamedTuple):
    """An image of method a that has the better SSIM, and one of b that has the better LPIPS."""

    a: Item
    b: Item
    view: int
    ssim: tuple[float, float]
    lpips: tuple[float, float]

    @property
    def size(self) -> float:
        """The product of both differences."""
        return (self.ssim[0] - self.ssim[1]) * (self.lpips[0] - self.lpips[1])


def values_of(rows: list[Row]) -> pd.DataFrame:
    """More is better: a line for each condition and method, a column for each metric of a value."""
    signed = [
        (
            row.condition,
            row.method,
            row.metric,
            row.value * (1 if higher_is_better(row.metric) else -1),
        )
        for row in rows
        if math.isfinite(row.value) and role(row.method) in ("", "floor")
    ]
    frame = pd.DataFrame(signed, columns=["condition", "method", "metric", "value"])
    frame = frame.drop_duplicates(["condition", "method", "metric"])
    order = list(dict.fromkeys(frame["metric"]))
    return frame.pivot(index=["condition", "method"], columns="metric", values="value")[order]


def orders(values: pd.DataFrame) -> str:
    """A line for each metric and condition: the methods, the best first."""
    lines = []
    for metric in values:
        for condition in dict.fromkeys(values.index.get_level_values("condition")):
            best = values.loc[condition, metric].dropna().sort_values(ascending=False)
            lines.append([str(metric), str(condition), ", ".join(map(str, best.index))])
    return markdown(["metric", "condition", "best first"], lines, left=3)


def correlations(values: pd.DataFrame) -> str:
    """Spearman's rank correlation of each pair of metrics, over what has both."""
    lines = []
    for one in values:
        cells = []
        for other in values:
            both = values[[one, other]].dropna() if one != other else values[[one]]
            constant = one == other or (both.nunique() < 2).any()
            cells.append("" if constant else f"{spearmanr(both[one], both[other]).statistic:.2f}")
        lines.append([str(one), *cells])
    return markdown(["", *map(str, values)], lines)


def disagreements(records: pd.DataFrame) -> list[Disagreement]:
    """The largest, each object and each pair of methods once."""
    chosen = records[(records["outcome"] == "ok") & (records["method"].map(role) == "")]
    found = []
    for _, of_view in chosen.groupby(["condition", "class", "object", "view"]):
        for one, other in combinations(of_view.to_dict("records"), 2):
            a, b = (one, other) if one["ssim"] > other["ssim"] else (other, one)
            if a["lpips"] > b["lpips"]:
                ssim, lpips = ((a[name], b[name]) for name in ("ssim", "lpips"))
                found.append(Disagreement(_item(a), _item(b), a["view"], ssim, lpips))
    kept: list[Disagreement] = []
    for one in sorted(found, key=lambda one: -one.size):
        seen = {(k.a.object, frozenset((k.a.method, k.b.method))) for k in kept}
        if all(one.a.object != obj and {one.a.method, one.b.method} != pair for obj, pair in seen):
            kept.append(one)
    return kept[:PAIRS]


def _item(record: Mapping[Any, Any]) -> Item:
    return Item(record["method"], record["condition"], record["class"], record["object"])


def sheet(directory: Path, shown: list[Disagreement]) -> list[Tile]:
    """For each the true image, that of a and that of b."""
    images = {one.item: one for one in artifacts_of(directory, read_jobs(directory))}
    tiles = []
    for one in shown:
        label = f"truth, {one.a.condition}"
        tiles.append(Tile(label, images[one.a.truth].images()[one.view][None]))
        for item, ssim, lpips in zip((one.a, one.b), one.ssim, one.lpips, strict=True):
            label = f"{item.method} {ssim:.2f} {lpips:.2f}"
            tiles.append(Tile(label, images[item].images()[one.view][None]))
    return tiles


def main() -> None:
    """Read a run from the command line."""
    parser = argparse.ArgumentParser(description="Where the metrics of a run agree, and where not.")
    parser.add_argument("directory", type=Path)
    parser.add_argument("-o", "--out", type=Path, default=Path("judges.png"))
    options = parser.parse_args()
    run = read_scored(options.directory)
    values = values_of([row for table in tables(run) for row in table.rows])
    print(orders(values), correlations(values), sep="\n")
    shown = disagreements(run.records)
    tiles = sheet(options.directory, shown)
    write_images(draw_sheet(tiles, 6, scale=2), options.out)
    print(f"pairs with SSIM and LPIPS below: {options.out}")


if __name__ == "__main__":
    main()
