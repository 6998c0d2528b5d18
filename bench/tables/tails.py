"""The table of tails: how bad the worst images of each method are, and which these are."""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping
from functools import partial
from typing import Any

import pandas as pd

from bench.analysis.comparison import NAN
from bench.analysis.digits import decimals
from bench.analysis.tails import INVENTED
from bench.catalogue.methods import role
from bench.tables.grid import (
    BEST,
    Block,
    Cell,
    measured,
    pivot,
    records,
    scored_as_blank,
    shown,
)
from bench.tables.quality import best_printed
from bench.tables.table import Table

TAILS = "tails"
_TOLD = {  # the captions of the values of a metric, and of the worst images by it
    "lpips": ("mean lpips of the worst 1 % of the images", "the image with the highest lpips"),
    "invented-holes": (
        "images with an invented hole, in per cent",
        "the image with the most pixels of invented holes",
    ),
    "invented-parts": (
        "images with an invented part, in per cent",
        "the image with the most pixels of invented parts",
    ),
}
_REMARK = (
    "Images count, those of all classes together, where other tables have means over objects. The "
    "worst 1 % are one image of each hundred, rounded up. An invented hole is what is not drawn at "
    "least 3 px inside the true silhouette, an invented part what is drawn at least 3 px outside "
    "it, in connected groups of 20 px or more. Failed images are scored as blank ones, which have "
    "a hole wherever the object has an inside, and no part; n_ok/n images. Lower is better."
)


def tails_table(rows: pd.DataFrame) -> Table:
    """Return the table of rows as `bench.analysis.tails.tail_rows` returns them."""
    title = "Tails: the worst images of each method"
    return Table(TAILS, title, rows, _layout, _REMARK)


def _layout(frame: pd.DataFrame) -> Iterator[Block]:
    """Yield for each metric the grid of its values, and that of the worst images."""
    yield _REMARK
    for metric, of_metric in frame.groupby("metric", sort=False):
        rows = records(of_metric.assign(images_of=of_metric["method"]))
        failed = [row for row in rows if row["n_ok"] < row["n"]]
        notes = tuple(
            f"{row['method']} at {row['condition']}: {scored_as_blank(row['n_ok'], row['n'])}"
            for row in failed
        )
        cells = ((partial(_value, best=best_printed(rows)), notes), (_worst, ()))
        for caption, (cell, below) in zip(_TOLD[str(metric)], cells, strict=True):
            yield f"## {caption.capitalize()}"
            yield pivot(
                of_metric,
                "method",
                "condition",
                cell,
                corner="method",
                about=lambda of_method: role(of_method[0]["method"]),
                caption=caption,
                notes=below,
                higher=False,
            )


def _value(row: Mapping[str, Any], best: Container[tuple[str, str, str]]) -> Cell:
    is_best = (row["class"], row["condition"], row["method"]) in best
    return measured(
        (row["value"], NAN, NAN),
        row["metric"],
        row["method"],
        count=(row["n_ok"], row["n"]),
        special=BEST if is_best else None,
    )


def _worst(row: Mapping[str, Any]) -> Cell:
    if not row["worst_object"]:
        return Cell("none", row["worst"])
    if row["metric"] in INVENTED:
        value = f"{row['worst']:.0f} px"
    else:
        value = shown(row["worst"], decimals(row["metric"], row["method"]))
    return Cell(f"{row['worst_object']}, view {row['worst_view']}: {value}", row["worst"])
