"""The table of tails: how bad the worst images of each method are, and which these are."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterator, Mapping
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
    Grid,
    measured,
    pivot,
    records,
    scored_as_blank,
    shown,
)
from bench.tables.quality import best_printed
from bench.tables.table import Table

TAILS = "tails"
_MEANING = {
    "lpips": "mean lpips of the worst 1 % of the images",
    "invented-holes": "images with an invented hole, in per cent",
    "invented-parts": "images with an invented part, in per cent",
}
_WORST = {
    "lpips": "the image with the highest lpips",
    "invented-holes": "the image with the most pixels of invented holes",
    "invented-parts": "the image with the most pixels of invented parts",
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
        meaning, worst = _MEANING[str(metric)], _WORST[str(metric)]
        yield f"## {meaning.capitalize()}"
        yield _values(of_metric, f"{meaning} (lower is better)")
        yield f"## {worst.capitalize()}"
        yield _by_cell(of_metric, _worst, worst)


def _values(frame: pd.DataFrame, caption: str) -> Grid:
    rows = [row | {"images_of": row["method"]} for row in records(frame)]
    notes = [
        f"{row['method']} at {row['condition']}: {scored}"
        for row in rows
        if (scored := scored_as_blank(row["n_ok"], row["n"]))
    ]
    return _by_cell(
        *(pd.DataFrame(rows), partial(_value, best=best_printed(rows)), caption),
        notes=tuple(notes),
    )


def _by_cell(
    frame: pd.DataFrame, cell: Callable[[Mapping[str, Any]], Cell], caption: str, **more: Any
) -> Grid:
    """Return a grid with methods down and conditions across; `more` are further fields of it."""
    return pivot(
        *(frame, "method", "condition", cell),
        corner="method",
        about=lambda rows: role(rows[0]["method"]),
        caption=caption,
        higher=False,
        **more,
    )


def _value(row: Mapping[str, Any], best: Container[tuple[str, str, str]]) -> Cell:
    is_best = (row["class"], row["condition"], row["method"]) in best
    return measured(
        *((row["value"], NAN, NAN), row["metric"], row["method"]),
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
