"""The method to take for a budget or a quality.

A method is affordable where its median cost is within the budget.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from bench.analysis.comparison import (
    Row,
    best_first,
    candidates,
    is_better,
    with_costs,
    worse_than_blank,
)
from bench.analysis.paired import CELL, LEAD, Verdicts
from data_prep.failures import BadInput

SSIM = "ssim"  # the metric of a required quality
BEST, NEXT, NO_BEST = "best", "next", "none within the budget, cheapest"
ENOUGH, SURE, NOT_ENOUGH = "good enough on average", "surely good enough", "none good enough, best"
ALTERNATIVES = 3


@dataclass(frozen=True)
class Requirements:
    """The limits of a choice; None for one that does not matter.

    views      number of images of a cloud
    budget_ms  most milliseconds for a cloud with all its images
    min_ssim   least mean over objects
    """

    views: int
    budget_ms: float | None = None
    min_ssim: float | None = None

    def __post_init__(self) -> None:
        """Raise BadInput without a limit, and for values out of range."""
        if self.budget_ms is None and self.min_ssim is None:
            raise BadInput("nothing to go by; give --budget-ms, --min-ssim, or both")
        if self.views < 1:
            raise BadInput(f"--views {self.views}: must be at least 1")
        if self.budget_ms is not None and not 0 < self.budget_ms < math.inf:
            raise BadInput(f"--budget-ms {self.budget_ms:g}: must be a number over 0")
        if self.min_ssim is not None and not -1 <= self.min_ssim <= 1:
            raise BadInput(f"--min-ssim {self.min_ssim:g}: must be from -1 to 1")


def recommend(
    compared: pd.DataFrame, request: Requirements, metrics: Sequence[str], verdicts: Verdicts
) -> tuple[pd.DataFrame, bool]:
    """Return the choices under each condition, and whether all meet the request.

    Methods without a cost (they failed on all objects), those whose cost is claimed, and those
    worse than a white image are no choice. Of methods that print equal the cheaper one is
    preferred.

    Parameters
    ----------
    compared : DataFrame
        A comparison by these metrics of images, and by `ssim` where a least SSIM is required.
    metrics : sequence of str
        The metrics that judge within the budget. Where they name different methods, which one is
        better depends on the metric, and no average would say so.

    Returns
    -------
    DataFrame
        Rows of the comparison with their costs, for each condition and class by each metric, with
        `choice`:

        * BEST: within the budget the best by its mean; `undecided` has the methods that it is not
          shown to be ahead of, `below` those that are no choice, as a white image is better
        * NEXT: up to ALTERNATIVES after it, of those that print equal the cheapest; `lead` with
          `lead_low` and `lead_high` is how much better the best is
        * NO_BEST: none is within the budget, and this is the cheapest; with `below`
        * SURE, or ENOUGH and then SURE: the cheapest whose mean SSIM is as required, and of which
          even the lower end of the interval is; within the budget or not
        * NOT_ENOUGH: none is good enough, and this is the best by SSIM

        Where there is no choice at all the method is "-".
    bool
        Whether each metric has a method within the budget, and one is good enough.
    """
    rows, met = list[Row](), True
    costed = with_costs(compared, request.views)
    for _, cell in costed.groupby(["condition", "class"], sort=False):
        none = {"method": "-"} | cell.iloc[0][["condition", "class"]].to_dict()
        for metric in metrics:
            ranked = _ranked(cell, metric, request)
            chosen = list(_within_budget(ranked, none | {"metric": metric}, verdicts))
            met &= chosen[0]["choice"] == BEST or request.budget_ms is None
            rows += chosen
        if request.min_ssim is not None:
            ranked = _ranked(cell, SSIM, request)
            rows += _good_enough(ranked, none | {"metric": SSIM}, request.min_ssim)
            affordable = ranked[ranked["usable"] & ranked["within"]]
            met &= bool((affordable["value"] >= request.min_ssim).any())
    return pd.DataFrame(rows, columns=[*costed, "choice", "undecided", "below", *LEAD]), met


def _ranked(cell: pd.DataFrame, metric: str, request: Requirements) -> pd.DataFrame:
    """Return the methods with a cost, the best first, whether `usable` and `within` the budget."""
    rows = cell[cell["metric"] == metric]
    measured = rows["method"].isin(candidates(rows["method"])) & ~rows["claimed"]
    ranked = best_first(rows[measured & np.isfinite(rows["cost_ms"])])
    return ranked.sort_values(["before", "cost_ms"], kind="stable").assign(
        usable=~ranked["method"].isin(worse_than_blank(rows)),
        within=ranked["cost_ms"] <= (math.inf if request.budget_ms is None else request.budget_ms),
    )


def _within_budget(ranked: pd.DataFrame, none: Row, verdicts: Verdicts) -> Iterator[Row]:
    below = ranked[~ranked["usable"] & ranked["within"]]["method"].tolist()
    affordable = ranked[ranked["usable"] & ranked["within"]].to_dict("records")
    if not affordable:
        cheapest = ranked[ranked["usable"]].sort_values(["cost_ms", "before"], kind="stable")
        yield _first(cheapest, none) | {"choice": NO_BEST, "below": below}
        return
    best, *others = affordable
    undecided = [m["method"] for m in others if not verdicts.shows(best["method"], m["method"], m)]
    yield best | {"choice": BEST, "undecided": undecided, "below": below}
    distinct = [best]
    for row in others:  # of those that print equal the first
        if is_better(distinct[-1], row):
            distinct.append(row)
    for row in distinct[1 : 1 + ALTERNATIVES]:
        cell = (row[name] for name in CELL)
        gap = verdicts.difference(row["method"], best["method"], *cell)
        yield row | {"choice": NEXT} | {end: gap[end] for end in LEAD}


def _good_enough(ranked: pd.DataFrame, none: Row, min_ssim: float) -> list[Row]:
    usable = ranked[ranked["usable"]]
    by_cost = usable.sort_values(["cost_ms", "before"], kind="stable")
    enough, sure = by_cost[by_cost["value"] >= min_ssim], by_cost[by_cost["ci_low"] >= min_ssim]
    if enough.empty:
        return [_first(usable, none) | {"choice": NOT_ENOUGH}]
    rows = [_first(enough, none) | {"choice": ENOUGH}, _first(sure, none) | {"choice": SURE}]
    return rows[1:] if rows[0]["method"] == rows[1]["method"] else rows


def _first(rows: pd.DataFrame, none: Row) -> Row:
    return (rows[:1].to_dict("records") or [none])[0]


def at_condition(compared: pd.DataFrame, condition: str | None) -> pd.DataFrame:
    """Return the rows at a condition; None: all.

    Raises BadInput for an unknown one, and where no object has scores.
    """
    if compared.empty:
        raise BadInput(
            "no object of this run has scores (0), as all true images failed; 'bench report DIR' "
            "shows why"
        )
    chosen = compared[(compared["condition"] == condition) | (condition is None)]
    if chosen.empty:
        known = ", ".join(compared["condition"].unique())
        raise BadInput(f"--condition {condition}: not in this run; there are {known}")
    return chosen
