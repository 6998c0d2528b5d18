"""Medians of samples, and the cost of V images of one cloud.

A cloud is prepared once and drawn any number of times. Drawing was timed in calls of one view and
of a batch of views; between them the cost of a call is taken to grow evenly, and more views than a
batch are drawn in batches. The costs of one view and of whole batches are as measured:

    total(V) = prepare + one + (V - 1) (all - one) / (batch - 1)    1 <= V <= batch
    total(V) = prepare + V all / batch                              V >= batch
"""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from bench.suites.speed.samples import Measurement, TimingSample
from data_prep.arrays import Floats

MS = 1000.0
UNITS = ("ms", "core-ms")  # by the clock, and of processor time

Statistics = dict[str, tuple[float, int]]  # by metric: a value, and of how many samples


def summarise(measurement: Measurement) -> Statistics:
    """Return medians over clouds and rounds, in milliseconds and MiB; NaN without a sample.

    cold-load, cold-prepare, cold-draw   the first call in its process; cold-picture is their sum
    prepare, draw-1, draw-V              warm: median, 95th percentile (p95) and median of the
                                         processor time (core); of a call, a view's share
    picture-of-1, picture-of-V           an image where 1 or V are drawn of a cloud, prepared
                                         for them: sums of the medians above
    further-view                         what each view more in a call costs, up to V
    peak-mib, idle-mib                   most memory of the process, and before the method's load
    """
    samples = pd.DataFrame(
        map(vars, measurement.samples), columns=[*TimingSample.__dataclass_fields__]
    )
    batch, values = measurement.views, Statistics()
    is_cold = samples["round"] == 0
    for stage in ("load", "prepare", "draw"):
        first = samples[is_cold & (samples["stage"] == stage)]
        values[f"cold-{stage}-ms"] = _percentile(MS * first["wall_s"])
    together = float(np.add.reduce([value for value, _ in values.values()]))
    values["cold-picture-ms"] = together, int(math.isfinite(together))
    for name, stage, views in (
        ("prepare", "prepare", 0),
        *((f"draw-{views}", "draw", views) for views in dict.fromkeys((1, batch))),
    ):
        warm = samples[~is_cold & (samples["stage"] == stage) & (samples["views"] == views)]
        share = MS / max(views, 1)
        values[f"{name}-ms"] = _percentile(share * warm["wall_s"])
        values[f"{name}-p95-ms"] = _percentile(share * warm["wall_s"], 95.0)
        values[f"{name}-core-ms"] = _percentile(share * warm["core_s"])
    for name, views in (*((f"picture-of-{v}", v) for v in (1, batch)), ("further-view", None)):
        for unit in UNITS:
            if views is None:
                cost = further_view(values, unit, batch)
            else:
                (cost,) = costs(values, unit, batch, [views])
            n = values[f"draw-{views or batch}-ms"][1]
            values[f"{name}-{unit}"] = float(cost), n if math.isfinite(cost) else 0
    for name, mib in (("peak-mib", measurement.peak_mib), ("idle-mib", measurement.idle_mib)):
        values[name] = (math.nan, 0) if mib is None else (mib, 1)
    return values


def costs(values: Statistics, unit: str, batch: int, views: ArrayLike) -> Floats:
    """Return the cost of an image where `views` [K] of a cloud are drawn; NaN where unknown."""
    prepare, single, share = _parts(values, unit, batch)
    count = np.asarray(views, float)
    within = single + (count - 1) * further_view(values, unit, batch)
    return (prepare + np.where(count < batch, within, count * share)) / count


def further_view(values: Statistics, unit: str, batch: int) -> float:
    """Return the cost of each view more in a call, up to a batch; NaN where unknown."""
    prepare, single, share = _parts(values, unit, batch)
    further = single if batch == 1 else (share * batch - single) / (batch - 1)
    return further + 0 * prepare  # unknown, too, where no cloud was prepared


def _parts(values: Statistics, unit: str, batch: int) -> list[float]:
    return [values[f"{name}-{unit}"][0] for name in ("prepare", "draw-1", f"draw-{batch}")]


def _percentile(samples: pd.Series, percent: float = 50.0) -> tuple[float, int]:
    count = len(samples)
    return float(np.percentile(samples, percent)) if count else math.nan, count
