"""The frontier of quality and cost: the methods that are worth their cost.

A method is on the frontier where it is not worse than a white image, and no other is at least as
good for at most its cost. That is decided by the values in the digits that both are printed with;
whether a method off the frontier is really worse, or only happened to come out so, is decided by
pairing it with the cheaper ones, object by object (`bench.analysis.paired.Verdicts`).
"""

from __future__ import annotations

from collections.abc import Container, Sequence

import numpy as np
import pandas as pd

from bench.analysis.comparison import (
    CLOUD,
    COST,
    VALUE,
    Row,
    best_first,
    candidates,
    is_better,
    with_costs,
    worse_than_blank,
)
from bench.analysis.condition_sweep import FAMILY
from bench.analysis.paired import Verdicts, better_by
from bench.catalogue.methods import FLOOR
from data_prep.scene import CLOUD_SIZE

LOST = ["lost", "lost_ci_low", "lost_ci_high"]
FRONTIER = [
    *("condition", "class", "views", "metric", "method", *COST, *VALUE),
    *("n_ok", "n", "verdict", "rival"),
]
WHOLE = ["class", "metric", "method"]
POINTS = [*WHOLE, "condition", "points", "views", *COST, *VALUE, *LOST]


def places(compared: pd.DataFrame, views: int, verdicts: Verdicts) -> pd.DataFrame:
    """Return the places of all methods of a comparison, for clouds with so many views.

    It has a row for each of the comparison: `condition`, `class`, `views`,
    `metric`, `method`; `cost_ms` (milliseconds for a cloud with its views) with `cost_ci_low`
    and `cost_ci_high`; `value` with `ci_low` and `ci_high`; `n_ok` and `n` (images that exist,
    and that should); `rival` (the method that costs no more and decides the verdict: for a
    dominated method the best that shows it, for a tied one the best, below a white image
    `blank`; else empty) and `verdict`:

    * "frontier": no other candidate is at least as good for at most this cost
    * "dominated": one that costs no more is shown to be better
    * "tied": one that costs no more is at least as good, but not shown to be better
    * "below a white image": it is worse than `blank`, which costs nothing
    * "reference": no candidate: it sees the mesh, or no cloud
    * "claimed": no candidate: its author states the cost, on another machine
    * "no value": it failed on all objects
    """
    rows, decided = with_costs(compared, views), {}
    for _, cell in rows.groupby(["condition", "class", "metric"], sort=False):
        below = worse_than_blank(cell)
        could = cell[cell["method"].isin(candidates(cell["method"])) & ~cell["claimed"]]
        rivals = best_first(could).to_dict("records")
        for at, row in zip(cell.index, cell.to_dict("records"), strict=True):
            decided[at] = ("claimed" if row["claimed"] else "reference", "")
            if at in could.index:
                decided[at] = _verdict(row, rivals, below, verdicts)
    verdict, rival = ([decided[at][i] for at in rows.index] for i in (0, 1))
    return rows.assign(verdict=verdict, rival=rival)[FRONTIER]


def _verdict(
    row: Row, rivals: Sequence[Row], below: Container[str], verdicts: Verdicts
) -> tuple[str, str]:
    if not np.isfinite((row["cost_ms"], row["value"])).all():
        return "no value", ""
    if row["method"] in below:
        return "below a white image", FLOOR
    cost = row["cost_ms"]
    better = [
        other
        for other in rivals
        if other["method"] != row["method"]
        and other["cost_ms"] <= cost
        and not is_better(row, other)
    ]
    if not any(other["cost_ms"] < cost or is_better(other, row) for other in better):
        return "frontier", ""
    for other in better:
        if verdicts.shows(other["method"], row["method"], row):
            return "dominated", other["method"]
    return "tied", better[0]["method"]


def thinned(compared: pd.DataFrame, views: int) -> pd.DataFrame:
    """Return the candidates at the conditions that only take points away, beside the full cloud.

    The number of points is a parameter of every method. None for a class without the full cloud.

    It has a row for each condition, class, method and metric: `class`, `metric`, `method`,
    `condition`, `points` (in each cloud), `views`; cost and value as in `places`; `lost` (quality
    that the full cloud has more, paired; over 0 where points help) with `lost_ci_low` and
    `lost_ci_high`; `claimed` (whether the cost is as its author states it).
    """
    steps = pd.DataFrame(FAMILY["points"].steps, columns=["points", "condition"])
    could = compared[compared["method"].isin(candidates(compared["method"]))]
    fewer = with_costs(could, views).merge(steps, on="condition")
    full = fewer.loc[fewer["points"] == CLOUD_SIZE, [*WHOLE, "value", "samples", "objects"]]
    both = fewer.merge(full, on=WHOLE, suffixes=("", "_full"))
    both = both[both["objects"] == both["objects_full"]]
    lost = [
        better_by(
            [row | {name: row[f"{name}_full"] for name in ("value", "samples")}], [row]
        ).estimate()
        for row in both.to_dict("records")
    ]
    both[LOST] = np.array(lost).reshape(-1, 3)
    order = both.groupby(CLOUD, sort=False).ngroup().sort_values(kind="stable").index
    return both.loc[order, [*POINTS, "claimed"]]
