"""The frontier of quality and cost: the methods that are worth their cost.

A method is on the frontier where it is not worse than a white image, and no other is at least as
good for at most its cost. That is decided by the values in the digits that both are printed with;
whether a method off the frontier is really worse, or only happened to come out so, is decided by
pairing it with the cheaper ones, object by object (`bench.analysis.differences.Verdicts`).
"""

from __future__ import annotations

from collections.abc import Container, Hashable, Sequence

import numpy as np
import pandas as pd

from bench.analysis.compare import (
    COST,
    IMAGE_SET,
    VALUE,
    Row,
    best_first,
    candidates,
    is_better,
    with_costs,
    worse_than_blank,
)
from bench.analysis.differences import Verdicts, better_by
from bench.analysis.sweeps import FAMILY_BY_ID
from bench.catalogue.methods import FLOOR
from data_prep.scene import CLOUD_SIZE

LOST = ["lost", "lost_ci_low", "lost_ci_high"]  # columns of the quality lost by fewer points
FRONTIER = [
    "condition",
    "class",
    "views",
    "metric",
    "method",
    *COST,
    *VALUE,
    "n_ok",
    "n",
    "verdict",
    "rival",
]
_SAME_METHOD = ["class", "metric", "method"]  # columns of what is compared with the full cloud
POINTS = [*_SAME_METHOD, "condition", "points", "views", *COST, *VALUE, *LOST]


def frontier_verdicts(compared: pd.DataFrame, views: int, verdicts: Verdicts) -> pd.DataFrame:
    """Return which methods of a comparison are on the frontier, for clouds with so many views.

    It has a row for each row of the comparison: `condition`, `class`, `views`, `metric`, `method`;
    `cost_ms` (milliseconds for a cloud with its views) with `cost_ci_low` and `cost_ci_high`;
    `value` with `ci_low` and `ci_high`; `n_ok` and `n` (images that exist, and that should exist);
    `verdict`, and `rival`, the method that the verdict follows from:

    * "frontier": no other candidate is at least as good for at most this cost; no rival
    * "dominated": a candidate that costs no more, the rival, is shown to be better; of several
      such candidates the rival is the best
    * "tied": candidates that cost no more are at least as good, but none is shown to be better;
      the rival is the best of them
    * "below a white image": it is worse than the rival `blank`, which costs nothing
    * "reference": it is no candidate, as it sees the mesh or no cloud
    * "claimed": it is no candidate, as its author states the cost, of another machine
    * "no value": it failed on all objects
    """
    rows = with_costs(compared, views)
    verdict: dict[Hashable, str] = {}
    rival: dict[Hashable, str] = {}
    for _, same_criterion in rows.groupby(["condition", "class", "metric"], sort=False):
        below = worse_than_blank(same_criterion)
        can_be_chosen = same_criterion["method"].isin(candidates(same_criterion["method"]))
        competing = same_criterion[can_be_chosen & ~same_criterion["claimed"]]
        rivals = best_first(competing).to_dict("records")
        for at, row in zip(same_criterion.index, same_criterion.to_dict("records"), strict=True):
            if at in competing.index:
                verdict[at], rival[at] = _verdict(row, rivals, below, verdicts)
            else:
                verdict[at], rival[at] = ("claimed" if row["claimed"] else "reference"), ""
    in_order = [verdict[at] for at in rows.index]
    return rows.assign(verdict=in_order, rival=[rival[at] for at in rows.index])[FRONTIER]


def _verdict(
    row: Row, rivals: Sequence[Row], below: Container[str], verdicts: Verdicts
) -> tuple[str, str]:
    """Return the verdict on a candidate and its rival, as `frontier_verdicts`.

    rivals  all candidates by the same criterion, the best first
    below   the methods that a white image is better than
    """
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


def thinned_clouds(compared: pd.DataFrame, views: int) -> pd.DataFrame:
    """Return what the candidates lose in quality, and save in cost, by clouds of fewer points.

    Only conditions are taken that do nothing but remove points. A class without the full cloud has
    no rows.

    It has a row for each condition, class, method and metric: `class`, `metric`, `method`,
    `condition`, `points` (in each cloud), `views`; cost and value as in `frontier_verdicts`; `lost`
    (how much better the method is with the full cloud, paired over objects; over 0 where more
    points help) with `lost_ci_low` and `lost_ci_high`; `claimed` (whether the cost is as its author
    states it).
    """
    steps = pd.DataFrame(FAMILY_BY_ID["points"].steps, columns=["points", "condition"])
    competing = compared[compared["method"].isin(candidates(compared["method"]))]
    fewer = with_costs(competing, views).merge(steps, on="condition")
    columns = [*_SAME_METHOD, "value", "samples", "objects"]
    full = fewer.loc[fewer["points"] == CLOUD_SIZE, columns]
    both = fewer.merge(full, on=_SAME_METHOD, suffixes=("", "_full"))
    both = both[both["objects"] == both["objects_full"]]
    lost = []
    for row in both.to_dict("records"):
        with_full_cloud = row | {"value": row["value_full"], "samples": row["samples_full"]}
        lost.append(better_by([with_full_cloud], [row]).estimate())
    both[LOST] = np.array(lost).reshape(-1, 3)
    order = both.groupby(IMAGE_SET, sort=False).ngroup().sort_values(kind="stable").index
    return both.loc[order, [*POINTS, "claimed"]]
