"""Comparisons of methods by a metric, as a run would have measured them."""

from __future__ import annotations

import numpy as np
import pandas as pd

from bench.analysis.compare import COLUMNS, mean_estimate
from bench.analysis.sweeps import CURVES


def comparison(methods, metric="ssim", condition="2048", class_name="chair"):
    """Methods by (milliseconds to prepare, milliseconds to draw a view, score of each object).

    Times may be one number, or one for each object. Two images an object are there.
    """
    rows = []
    for method, (prepare_ms, draw_ms, scores) in methods.items():
        scores = np.array(scores, float)
        nothing = np.zeros(len(scores))
        times = (nothing + np.array(ms) / 1000 for ms in (prepare_ms, draw_ms))
        images = (2 * len(scores),) * 2
        names = tuple("abcdefghijklmnopqrstuvwx"[: len(scores)])
        value = (*mean_estimate(metric, scores), scores, names)
        cell = (condition, class_name, metric, method, method)
        rows.append((*cell, *value, *times, *images, False))
    return pd.DataFrame(rows, columns=COLUMNS)


def row_of(frame, **where):
    """Return the row with these values by column, which has to be the only one."""
    for column, value in where.items():
        frame = frame[frame[column] == value]
    (row,) = frame.to_dict("records")
    return row


def curve_of(family, method, values, metric="ssim", reach=(0.02, 0.03)):
    """Return a method along a family, as `condition_curves` has it.

    Intervals reach so far below and above the values.
    """
    low, high = reach
    return pd.DataFrame(
        [
            ("chair", family.id, metric, method, condition, at, v, v - low, v + high)
            for (at, condition), v in zip(family.steps, values, strict=True)
        ],
        columns=CURVES,
    )
