"""Scores of meshes as means over objects.

A frame of meshes has a row for each method, condition and object: the names in JOB, a column for
each of SURFACE_METRICS, and `note`, why there is no mesh.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from bench.analysis.compare import NAN
from bench.analysis.intervals import mean_interval
from bench.analysis.paper import AVERAGE
from bench.metrics.surface_distance import SURFACE_METRICS


def surface_rows(meshes: pd.DataFrame) -> pd.DataFrame:
    """Return the mean over classes of the means over objects, by condition, method and metric.

    `n_ok` meshes of `n` have scores.
    """
    rows = []
    class_name = AVERAGE if meshes["class"].nunique() > 1 else meshes["class"].iloc[0]
    for (condition, method), every in meshes.groupby(["condition", "method"], sort=False):
        scored = every[every["note"] == ""]
        counts = every.loc[every["note"] != "", "note"].value_counts()
        note = "; ".join(f"{count} x {reason}" for reason, count in counts.items())
        for metric in SURFACE_METRICS:
            samples = [values.to_numpy() for _, values in scored.groupby("class")[metric]]
            value = float(np.mean([of_class.mean() for of_class in samples])) if samples else NAN
            estimate = value, *mean_interval(*samples), len(scored), len(every)
            rows.append((method, condition, class_name, metric, *estimate, note))
    columns = ["method", "condition", "class", "metric", "value", "ci_low", "ci_high"]
    return pd.DataFrame(rows, columns=[*columns, "n_ok", "n", "note"])
