"""The table of methods along families of conditions: which is ahead, and where that changes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import pandas as pd

from bench.analysis.condition_sweep import FAMILY, LEADS
from bench.catalogue.conditions import Family
from bench.catalogue.suites import TableSpec
from bench.tables import markdown
from bench.tables.grid import Annotation, Block, Cell, Grid, measured, pivot, records
from bench.tables.table import Table

AHEAD = Annotation("ahead", "**{value}{interval}**")
BEHIND = Annotation("behind", "*{value}{interval}*", against=True)
SIDES = ["family", "method", "rival"]


def condition_sweep_table(spec: TableSpec, suite: str, leads: pd.DataFrame) -> Table:
    """Return the table of the leads of a run, as `condition_leads` returns them."""
    frame = leads[LEADS].reset_index(drop=True)
    frame.insert(0, "suite", suite)
    remark = _LEGEND.format(marks="“ahead”: the first method is, “behind”: the second is,")
    return Table(spec.name, spec.title, frame, _layout, remark)


def _layout(leads: pd.DataFrame) -> Iterator[Block]:
    """Yield who is ahead at both ends and where that changes; then the lead at each step."""
    yield _LEGEND.format(marks="**Bold**: the first is ahead, *italic*: the second,")
    several = leads["class"].nunique() > 1
    for class_name, of_class in leads.groupby("class", sort=False):
        where = f", {class_name}" if several else ""
        yield f"## {markdown.cell(f'From end to end{where}')}"
        yield _summary(of_class, str(class_name))
        for name, of_family in of_class.groupby("family", sort=False):
            yield f"## {markdown.cell(FAMILY[str(name)].axis + where)}"
            yield _leads(of_family, str(class_name), FAMILY[str(name)])


_LEGEND = (
    "How much better the first method is than the second, over 0 if it is, [interval, paired over "
    "objects], failed images scored as blank ones. {marks} by an interval without 0; intervals of "
    "a metric hold in 95 % for all its cells together. Curves cross where the lead passes through "
    "0, on straight lines between what was measured (on the logarithm of the number of points and "
    "of the ratio of densities); in brackets as far as its interval holds 0."
)


def _shown_in_training(family: Family) -> str:
    """Return the range that networks were trained on: "splat-net@chair 512 to 2048"."""
    return ", ".join(
        f"{name} {least:g}" + (f" to {most:g}" if most > least else " only")
        for name, least, most in family.trained
    )


def end_to_end_text(steps: Sequence[Mapping[str, Any]]) -> str:
    """Return who is ahead at the first and at the last step, and where the curves cross."""
    first, last = steps[0]["ahead"], steps[-1]["ahead"]
    ends = first if first == last else f"{first}, then {last}"
    crossings = " and ".join(crossing_text(step) for step in steps if step["crossing"] > -math.inf)
    return f"{ends}; {f'crosses at {crossings}' if crossings else 'none within'}"


def crossing_text(step: Mapping[str, Any]) -> str:
    """Return the place of a crossing with three digits: "0.137 [0.12, 0.15]"."""
    at, low, high = (
        f"{value:.0f}" if value >= 100 else f"{value:.3g}"
        for value in (step["crossing"], step["crossing_low"], step["crossing_high"])
    )
    return f"{at} [{low}, {high}]" if math.isfinite(step["crossing_low"]) else at


def _summary(leads: pd.DataFrame, class_name: str) -> Grid:
    """Return the pairs of methods along families down, metrics across."""
    rows = []
    for (*sides, metric), group in leads.groupby([*SIDES, "metric"], sort=False):
        steps = records(group)
        ends = {"from": steps[0]["condition"], "to": steps[-1]["condition"]}
        text = end_to_end_text(steps)
        rows.append({"sides": tuple(sides), "metric": metric, "text": text} | ends)
    return pivot(
        pd.DataFrame(rows),
        "sides",
        "metric",
        lambda row: Cell(row["text"]),
        line_name=lambda row: row["sides"][0],
        before={
            "from": lambda row: Cell(row["from"]),
            "to": lambda row: Cell(row["to"]),
            "first": lambda row: Cell(row["sides"][1]),
            "second": lambda row: Cell(row["sides"][2]),
        },
        corner="family",
        caption=f"from end to end, {class_name}",
    )


def _leads(leads: pd.DataFrame, class_name: str, family: Family) -> Grid:
    """Return the leads along one family, metrics down and steps across."""
    rows = [row | {"pair": (row["metric"], row["method"], row["rival"])} for row in records(leads)]
    return pivot(
        pd.DataFrame(rows),
        "pair",
        "condition",
        _lead,
        line_name=lambda row: row["metric"],
        column_name=dict(zip(leads["condition"], leads["at"], strict=True)).__getitem__,
        before={"first": lambda row: Cell(row["method"]), "second": lambda row: Cell(row["rival"])},
        corner="metric",
        caption=f"lead along {family.axis}, {class_name}",
        remark=f"In training: {_shown_in_training(family)}." if family.trained else "",
    )


def _lead(row: Mapping[str, Any]) -> Cell:
    sides = row["method"], row["rival"]
    lead = row["lead"], row["ci_low"], row["ci_high"]
    special = dict(zip(sides, (AHEAD, BEHIND), strict=True)).get(row["ahead"])
    return measured(lead, row["metric"], *sides, sign="+", special=special)
