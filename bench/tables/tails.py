"""The table of tails: how bad the worst images of each method are, and which these are."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import pandas as pd

from bench.analysis.compare import NAN
from bench.analysis.digits import decimals
from bench.analysis.tails import INVENTED
from bench.tables.grid import (
    BEST,
    Block,
    Cell,
    Grid,
    metric_cell,
    number_text,
    pivot,
    role_in_words,
    row_mappings,
    scored_as_blank,
)
from bench.tables.quality import best_printed
from bench.tables.table import Table

TAILS = "tails"
_CAPTIONS = {  # by metric: of the grid of values, and of the grid of the worst images
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
        rows = row_mappings(of_metric.assign(images_of=of_metric["method"]))
        notes = []
        for row in rows:
            if lacking := scored_as_blank(row["n_ok"], row["n"]):
                notes.append(f"{row['method']} at {row['condition']}: {lacking}")
        caption_of_values, caption_of_worst = _CAPTIONS[str(metric)]
        value = partial(_value, best=best_printed(rows))
        yield f"## {caption_of_values.capitalize()}"
        yield _grid(of_metric, value, caption_of_values, notes)
        yield f"## {caption_of_worst.capitalize()}"
        yield _grid(of_metric, _worst, caption_of_worst)


def _grid(
    frame: pd.DataFrame, cell: Callable[[Any], Cell], caption: str, notes: Sequence[str] = ()
) -> Grid:
    """Return a grid of the rows of a metric, methods down and conditions across."""
    return pivot(
        frame,
        line="method",
        column="condition",
        cell=cell,
        corner="method",
        about=lambda of_method: role_in_words(of_method[0]["method"]),
        caption=caption,
        notes=tuple(notes),
        higher=False,
    )


def _value(row: Mapping[str, Any], best: Container[tuple[str, str, str]]) -> Cell:
    """Return the value and the number of images; `best` as `best_printed` returns it."""
    is_best = (row["class"], row["condition"], row["method"]) in best
    return metric_cell(
        (row["value"], NAN, NAN),
        row["metric"],
        row["method"],
        count=(row["n_ok"], row["n"]),
        special=BEST if is_best else None,
    )


def _worst(row: Mapping[str, Any]) -> Cell:
    """Return the object and the view of the worst image, with its value."""
    if not row["worst_object"]:
        return Cell("none", row["worst"])
    if row["metric"] in INVENTED:
        value = f"{row['worst']:.0f} px"
    else:
        value = number_text(row["worst"], decimals(row["metric"], row["method"]))
    return Cell(f"{row['worst_object']}, view {row['worst_view']}: {value}", row["worst"])
