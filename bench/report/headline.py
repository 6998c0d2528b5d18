"""The headline of a report: one compact table of the values, methods by their first metric."""

from __future__ import annotations

import math
from collections.abc import Container, Mapping
from typing import Any

import numpy as np
import pandas as pd

from bench.analysis.comparison import is_better
from bench.analysis.digits import decimals, is_coarse
from bench.catalogue.conditions import condition_name, condition_words
from bench.catalogue.methods import FLOOR, role
from bench.catalogue.metrics import higher_is_better
from bench.tables.grid import MOVED, ordered, records, shown
from bench.tables.quality import best_printed

_Key = tuple[str, str, str]  # method, metric, condition


def compact_table(rows: pd.DataFrame) -> dict[str, Any] | None:
    """Return the values of the headline, with a column for each metric and condition.

    The best of the first metric stand first, the reference methods last. The best of a column is
    marked, and what is worse than a white image. `rows` are those of `quality_frame`; None without
    a value.
    """
    rows = rows[~rows["skipped"].astype(bool)]
    if not np.isfinite(rows["value"].astype(float)).any():
        return None
    metrics = ordered(rows["metric"])
    columns = ordered(zip(rows["metric"], rows["condition"], strict=True))
    columns.sort(key=lambda column: metrics.index(column[0]))
    cells = {(r["method"], r["metric"], r["condition"]): r for r in records(rows)}
    best = {
        (method, metric, condition)
        for metric in metrics
        for _, condition, method in best_printed(records(rows[rows["metric"] == metric]))
    }

    def mean_first(method: str) -> tuple[bool, float]:
        of_first = [cells.get((method, metrics[0], c)) for _, c in columns]
        digits = [decimals(metrics[0], row["images_of"]) if row else 0 for row in of_first]
        values = [round(row["value"], n) for row, n in zip(of_first, digits, strict=True) if row]
        values = [value for value in values if math.isfinite(value)]
        mean = float(np.mean(values)) if values else math.nan
        worse = math.inf if not values else -mean if higher_is_better(metrics[0]) else mean
        return role(method) in ("ceiling", "floor"), worse

    methods = sorted(ordered(rows["method"]), key=mean_first)
    names = [condition_name(condition) for _, condition in columns]
    over_conditions = f", mean over {len(columns) // len(metrics)} conditions"
    return {
        "caption": f"Best first by {metrics[0]}{over_conditions * (len(columns) > len(metrics))}",
        "metrics": [
            (metric, higher_is_better(metric), sum(m == metric for m, _ in columns))
            for metric in metrics
        ],
        "columns": [
            (metric, higher_is_better(metric), name.kind * (name.kind != "points"), name)
            for (metric, _), name in zip(columns, names, strict=True)
        ],
        "lines": [(m, role(m), [_cell(cells, best, (m, *c)) for c in columns]) for m in methods],
        "failed": bool(rows["failed"].any()),
        "coarse": any(is_coarse(r["metric"], r["images_of"]) for r in cells.values()),
    }


def _cell(cells: Mapping[_Key, Any], best: Container[_Key], key: _Key) -> dict[str, Any]:
    row, (method, metric, condition) = cells.get(key), key
    if row is None or not math.isfinite(row["value"]):
        about = row["note"] if row else "not measured"
        return {"text": "–", "value": None, "about": about, "best": False, "below": False}
    digits, mark = decimals(metric, row["images_of"]), MOVED * is_coarse(metric, row["images_of"])
    about = [f"{method}, {metric}, {condition_words(condition)}"]
    if math.isfinite(row["low"]):
        about.append(f"95 % interval {shown(row['low'], digits)} to {shown(row['high'], digits)}")
    if row["failed"]:
        about.append(f"{row['n_ok']} of {row['n']} images, the others scored as blank ones")
    blank = cells.get((FLOOR, metric, condition))
    return {
        "text": f"{mark}{shown(row['value'], digits)}{'*' * row['failed']}",
        "value": row["value"],
        "about": "; ".join(about),
        "best": key in best,
        "below": blank is not None and is_better(blank, row),
    }
