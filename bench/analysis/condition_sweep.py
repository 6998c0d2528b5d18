"""Methods along families of conditions: which is ahead, and where that changes.

Methods are compared on the same objects, failed images scored as blank ones
(`bench.analysis.paired.Verdicts`). Between the conditions that were measured a curve is a straight
line on the axis of the family: on the logarithm where the axis is logarithmic.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import pandas as pd

from bench.analysis.comparison import NAN, VALUE, Estimate
from bench.analysis.paired import LEAD, Verdicts, who_is_ahead
from bench.catalogue.conditions import FAMILIES, Family, families_of
from bench.catalogue.lookup import family_of

# Who is set against whom; settings and weights of a method (`pc2pix@FILE`) stand for it too.
PAIRS = (("splat-net", "surface-apss"), ("pc2pix", "surface-apss"), ("splat-net", "pc2pix"))
FAMILY = {family.id: family for family in FAMILIES}
UNDECIDED = "undecided"
NO_VALUE = "no value"
CURVES = ["class", "family", "metric", "method", "condition", "at", *VALUE]
LEADS = [
    *("class", "family", "metric", "method", "rival", "condition", "at", "unseen_by"),
    *("value", "rival_value", "lead", "ci_low", "ci_high", "ahead"),
    *("crossing", "crossing_low", "crossing_high"),
]


def condition_curves(compared: pd.DataFrame) -> pd.DataFrame:
    """Return every method along every family of the conditions.

    compared  as `bench.analysis.comparison.compare` returns it

    It has a row for each class, family, metric, method and condition, in this order, the conditions
    of a family in that of its axis: `class`, `family` (its id), `metric`, `method`, `condition`,
    `at` (the condition's value on the axis), `value`, `ci_low` and `ci_high` (the interval over
    objects; NaN where there is none).
    """
    parts = [compared.assign(family="", at=NAN)[:0]]
    for _, of_class in compared.groupby("class", sort=False):
        order = of_class.drop_duplicates(["metric", "method"])[["metric", "method"]]
        for family in families_of(of_class["condition"]):
            steps = pd.DataFrame(family.steps, columns=["at", "condition"]).assign(family=family.id)
            parts.append(order.merge(steps, how="cross").merge(of_class))
    return pd.concat(parts, ignore_index=True)[CURVES]


def condition_leads(curves: pd.DataFrame, verdicts: Verdicts) -> pd.DataFrame:
    """Return the pairs of the methods along every family.

    curves    as `condition_curves` returns them
    verdicts  of the same run, by the metrics of the curves

    It has a row for each class, family, metric, pair and condition: `class`, `family`, `metric`,
    `method`, `rival`, `condition`, `at` (text), `unseen_by` (networks that were not shown such
    clouds in training), `value` and `rival_value`; `lead` (how much better the method is than its
    rival, paired over objects) with `ci_low` and `ci_high`, the interval that decides; `ahead` (the
    better method by an interval without 0, or why none is); `crossing` (the place on the axis where
    the curves cross, at the condition or before the next; NaN where they do not) with
    `crossing_low` and `crossing_high`, the places around it as far as the interval of the lead
    holds 0: an end of the family where it still does there, NaN where a lead has no interval.
    """
    parts = []
    for cell, steps in curves.groupby(CURVES[:3], sort=False):
        class_name, name, metric = map(str, cell)
        values = {method: rows["value"].tolist() for method, rows in steps.groupby("method")}
        conditions = steps["condition"].unique()
        family = FAMILY[name]
        places = {condition: at for at, condition in family.steps}
        for method, rival in _pairs_among(steps["method"].unique()):
            cells = (
                verdicts.difference(rival, method, metric, condition, class_name)
                for condition in conditions
            )
            leads = [Estimate(*(cell[end] for end in LEAD)) for cell in cells]
            at = [places[condition] for condition in conditions]
            parts.append(
                pd.DataFrame(leads, columns=["lead", "ci_low", "ci_high"]).assign(
                    **{"class": class_name},
                    family=name,
                    metric=metric,
                    method=method,
                    rival=rival,
                    condition=conditions,
                    at=[f"{value:g}" for value in at],
                    unseen_by=[" ".join(family.unseen_by(value)) for value in at],
                    value=values[method],
                    rival_value=values[rival],
                    ahead=[better_of(lead, method, rival) for lead in leads],
                    **crossings(family, at, leads),
                )
            )
    return pd.concat(parts)[LEADS] if parts else pd.DataFrame(columns=LEADS)


def crossings(
    family: Family, at: Sequence[float], leads: Sequence[Estimate]
) -> dict[str, list[float]]:
    """Return the columns `crossing`, `crossing_low` and `crossing_high` of leads at these values.

    A curve that only touches 0 has no crossing there.
    """
    places = [place_of(value, family) for value in at]
    values, lows, highs = zip(*leads, strict=True)
    # 0 leaves the interval where one of its ends passes through 0.
    left = [place for _, place in (*sign_changes(places, lows), *sign_changes(places, highs))]
    sure = all(map(math.isfinite, (*lows, *highs)))
    columns = {name: [NAN] * len(at) for name in LEADS[-3:]}
    for step, place in sign_changes(places, values):
        low = max(p for p in (*left, min(places)) if p <= place) if sure else NAN
        high = min(p for p in (*left, max(places)) if p >= place) if sure else NAN
        for column, p in zip(columns.values(), (place, low, high), strict=True):
            column[step] = 2.0**p if family.logarithmic else p
    return columns


def _pairs_among(methods: Sequence[str]) -> list[tuple[str, str]]:
    """Return the pairs of PAIRS that these methods make up."""
    return [
        (method, rival)
        for first, second in PAIRS
        for method in methods
        for rival in methods
        if (family_of(method), family_of(rival)) == (first, second)
    ]


def sign_changes(places: Sequence[float], values: Sequence[float]) -> list[tuple[int, float]]:
    """Return where straight lines through (place, value) pass from one side of 0 to the other.

    Each is (number of the step before, place). Steps without a value (NaN) join nothing. A stretch
    at 0 between two sides counts as its first step.
    """
    sided = [i for i, value in enumerate(values) if value != 0]
    changes = []
    for i, j in pairwise(sided):
        if values[i] * values[j] < 0:
            share = values[i] / (values[i] - values[i + 1])
            changes.append((i, places[i] + share * (places[i + 1] - places[i])))
    return changes


def better_of(lead: Estimate, method: str, rival: str) -> str:
    """Return the better one of two methods by an interval without 0, or why none is."""
    if not math.isfinite(lead.value):
        return NO_VALUE
    return {"a": rival, "b": method}.get(who_is_ahead(lead), UNDECIDED)


def place_of(value: float, family: Family) -> float:
    """Return the place of a value on an axis whose equal steps are equally far apart."""
    return math.log2(value) if family.logarithmic else value
