"""The headline of a report: one compact table of the values, methods by their first metric."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Container, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from bench.analysis.comparison import is_better
from bench.analysis.digits import decimals, is_coarse
from bench.catalogue.conditions import condition_name, condition_words
from bench.catalogue.methods import FLOOR, role
from bench.catalogue.metrics import higher_is_better
from bench.tables.grid import MOVED, number_text, ordered, row_mappings
from bench.tables.quality import best_printed

_Key = tuple[str, str, str]  # method, metric and condition of a cell


def compact_table(rows: pd.DataFrame) -> dict[str, Any] | None:
    """Return the values of the headline, with a column for each metric and condition.

    rows  as `quality_frame` returns them

    The best by the first metric stand first, the reference methods last. The best of a column is
    marked, and what is worse than a white image. None where no method has a value.
    """
    rows = rows[~rows["skipped"].astype(bool)]
    if not np.isfinite(rows["value"].astype(float)).any():
        return None
    metrics = ordered(rows["metric"])
    columns = ordered(zip(rows["metric"], rows["condition"], strict=True))
    columns.sort(key=lambda column: metrics.index(column[0]))
    row_of = {(row["method"], row["metric"], row["condition"]): row for row in row_mappings(rows)}
    best: set[_Key] = set()
    for metric in metrics:
        of_metric = row_mappings(rows[rows["metric"] == metric])
        best |= {(method, metric, at) for _, at, method in best_printed(of_metric)}

    def sort_key(method: str) -> tuple[bool, float]:
        is_reference = role(method) in ("ceiling", "floor")
        of_first = [row_of.get((method, metrics[0], condition)) for _, condition in columns]
        mean = _mean_printed(metrics[0], [row for row in of_first if row])
        if math.isnan(mean):
            return is_reference, math.inf
        return is_reference, -mean if higher_is_better(metrics[0]) else mean

    methods = sorted(ordered(rows["method"]), key=sort_key)
    caption = f"Best first by {metrics[0]}"
    if len(columns) > len(metrics):
        caption += f", mean over {len(columns) // len(metrics)} conditions"
    heads = []
    for metric, condition in columns:
        name = condition_name(condition)
        kind = name.kind if name.kind != "points" else ""
        heads.append((metric, higher_is_better(metric), kind, name))
    lines = []
    for method in methods:
        cells = [_cell(row_of, best, (method, *column)) for column in columns]
        lines.append((method, role(method), cells))
    widths = Counter(metric for metric, _ in columns)
    return {
        "caption": caption,
        "metrics": [(metric, higher_is_better(metric), widths[metric]) for metric in metrics],
        "columns": heads,
        "lines": lines,
        "failed": bool(rows["failed"].any()),
        "coarse": any(is_coarse(row["metric"], row["images_of"]) for row in row_of.values()),
    }


def _mean_printed(metric: str, rows: Sequence[Mapping[str, Any]]) -> float:
    """Return the mean of the values in the digits that are printed; NaN where there is none."""
    values = [round(row["value"], decimals(metric, row["images_of"])) for row in rows]
    finite = [value for value in values if math.isfinite(value)]
    return float(np.mean(finite)) if finite else math.nan


def _cell(rows: Mapping[_Key, Any], best: Container[_Key], key: _Key) -> dict[str, Any]:
    """Return the cell of a method by a metric at a condition; a dash where it has no value."""
    row, (method, metric, condition) = rows.get(key), key
    if row is None or not math.isfinite(row["value"]):
        about = row["note"] if row else "not measured"
        return {"text": "–", "value": None, "about": about, "best": False, "below": False}
    digits = decimals(metric, row["images_of"])
    about = [f"{method}, {metric}, {condition_words(condition)}"]
    if math.isfinite(row["low"]):
        low, high = number_text(row["low"], digits), number_text(row["high"], digits)
        about.append(f"95 % interval {low} to {high}")
    if row["failed"]:
        about.append(f"{row['n_ok']} of {row['n']} images, the others scored as blank ones")
    text = number_text(row["value"], digits)
    if is_coarse(metric, row["images_of"]):
        text = MOVED + text
    if row["failed"]:
        text += "*"
    blank = rows.get((FLOOR, metric, condition))
    return {
        "text": text,
        "value": row["value"],
        "about": "; ".join(about),
        "best": key in best,
        "below": blank is not None and is_better(blank, row),
    }
