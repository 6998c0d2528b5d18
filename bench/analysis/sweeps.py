"""Methods along families of conditions: which is ahead, and where that changes.

Methods are compared on the same objects, failed images scored as blank ones
(`bench.analysis.differences.Verdicts`). Between the conditions that were measured a curve is a
straight line on the axis of the family: on the logarithm where the axis is logarithmic.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise, product

import pandas as pd

from bench.analysis.compare import NAN, VALUE, Estimate
from bench.analysis.differences import Verdicts, lead_of, who_is_ahead
from bench.catalogue.conditions import FAMILIES, Family, families_of
from bench.catalogue.lookup import family_of

# The pairs (method, rival) that are compared. A method with a setting or with weights of a file
# (`pc2pix@FILE`) is compared like the method itself.
PAIRS = (("splat-net", "surface-apss"), ("pc2pix", "surface-apss"), ("splat-net", "pc2pix"))
FAMILY_BY_ID = {family.id: family for family in FAMILIES}
UNDECIDED = "undecided"  # in the column `ahead`: the interval holds 0
NO_VALUE = "no value"  # in the column `ahead`: one of the two has no value
CURVES = ["class", "family", "metric", "method", "condition", "at", *VALUE]
CROSSINGS = ["crossing", "crossing_low", "crossing_high"]
LEADS = [
    "class",
    "family",
    "metric",
    "method",
    "rival",
    "condition",
    "at",
    "unseen_by",
    "value",
    "rival_value",
    "lead",
    "ci_low",
    "ci_high",
    "ahead",
    *CROSSINGS,
]


def condition_curves(compared: pd.DataFrame) -> pd.DataFrame:
    """Return the values of every method along every family of the conditions.

    compared  as `bench.analysis.compare.compare` returns it

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
    """Return for each pair of PAIRS how far the method is ahead, along every family.

    curves    as `condition_curves` returns them
    verdicts  of the same run, by the metrics of the curves

    It has a row for each class, family, metric, pair and condition: `class`, `family`, `metric`,
    `method`, `rival`, `condition`, `at` (text), `unseen_by` (networks that were not shown such
    clouds in training), `value` and `rival_value`; `lead` (how much better the method is than its
    rival, paired over objects) with `ci_low` and `ci_high`, the interval by which `ahead` is
    decided (the better method where it leaves out 0, else why none is); `crossing` (the value on
    the axis where the curves cross, at the condition or before the next one; NaN where they do
    not) with `crossing_low` and `crossing_high`: between these two the interval of the lead holds
    0. They are an end of the family where it still holds 0 there, and NaN where a lead has no
    interval.
    """
    parts = []
    for group, steps in curves.groupby(["class", "family", "metric"], sort=False):
        class_name, name, metric = map(str, group)
        values = {method: rows["value"].tolist() for method, rows in steps.groupby("method")}
        conditions = steps["condition"].unique()
        family = FAMILY_BY_ID[name]
        value_on_axis = {condition: value for value, condition in family.steps}
        at = [value_on_axis[condition] for condition in conditions]
        for method, rival in _pairs_among(steps["method"].unique()):
            leads = []
            for condition in conditions:
                row = verdicts.difference(rival, method, metric, condition, class_name)
                leads.append(lead_of(row))
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
    """Return the columns `crossing`, `crossing_low` and `crossing_high`, a value for each lead.

    at     values of the conditions on the axis of the family
    leads  how much better one method is than the other, at each of these values

    A lead that only touches 0 and keeps its sign has no crossing there.
    """
    positions = [axis_position(value, family) for value in at]
    values, lows, highs = zip(*leads, strict=True)
    # 0 leaves the interval where one of its ends passes through 0.
    changes = (*sign_changes(positions, lows), *sign_changes(positions, highs))
    ends = [position for _, position in changes]
    has_intervals = all(map(math.isfinite, (*lows, *highs)))
    columns = {name: [NAN for _ in at] for name in CROSSINGS}
    for step, position in sign_changes(positions, values):
        low, high = NAN, NAN
        if has_intervals:
            low = max(end for end in (*ends, min(positions)) if end <= position)
            high = min(end for end in (*ends, max(positions)) if end >= position)
        columns["crossing"][step] = axis_value(position, family)
        columns["crossing_low"][step] = axis_value(low, family)
        columns["crossing_high"][step] = axis_value(high, family)
    return columns


def _pairs_among(methods: Sequence[str]) -> list[tuple[str, str]]:
    """Return the pairs of PAIRS that there are among these methods, their settings included."""
    pairs = []
    for first, second in PAIRS:
        of_first = [method for method in methods if family_of(method) == first]
        of_second = [method for method in methods if family_of(method) == second]
        pairs += product(of_first, of_second)
    return pairs


def sign_changes(positions: Sequence[float], values: Sequence[float]) -> list[tuple[int, float]]:
    """Return where the straight lines between the points (position, value) cross 0.

    Each crossing is (number of the step before it, position). No line joins a step without a value
    (NaN). Where several steps are at 0 between a value above and one below, the crossing is at the
    first of them.
    """
    not_zero = [step for step, value in enumerate(values) if value != 0]
    changes = []
    for step, next_step in pairwise(not_zero):
        if values[step] * values[next_step] < 0:
            share = values[step] / (values[step] - values[step + 1])
            distance = positions[step + 1] - positions[step]
            changes.append((step, positions[step] + share * distance))
    return changes


def better_of(lead: Estimate, method: str, rival: str) -> str:
    """Return the better one of two methods by an interval without 0, or why none is."""
    if not math.isfinite(lead.value):
        return NO_VALUE
    match who_is_ahead(lead):
        case "a":
            return rival
        case "b":
            return method
        case _:
            return UNDECIDED


def axis_position(value: float, family: Family) -> float:
    """Return the position of a value on the axis of a family, which may be logarithmic."""
    return math.log2(value) if family.logarithmic else value


def axis_value(position: float, family: Family) -> float:
    """Return the value that stands at a position on the axis of a family."""
    return 2.0**position if family.logarithmic else position
