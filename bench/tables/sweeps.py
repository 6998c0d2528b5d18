"""The table of methods along families of conditions: which is ahead, and where that changes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from operator import itemgetter
from typing import Any

import pandas as pd

from bench.analysis.sweeps import FAMILY_BY_ID, LEADS
from bench.catalogue.conditions import Family
from bench.catalogue.suites import TableSpec
from bench.tables import markdown
from bench.tables.grid import Annotation, Block, Cell, Grid, metric_cell, pivot, row_mappings
from bench.tables.table import Table

AHEAD = Annotation("ahead", "**{value}{interval}**")
BEHIND = Annotation("behind", "*{value}{interval}*", against=True)
SIDES = ["family", "method", "rival"]  # columns of a pair of methods along a family


def condition_sweep_table(spec: TableSpec, suite: str, leads: pd.DataFrame) -> Table:
    """Return the table of leads, a frame as `condition_leads` returns it."""
    frame = leads[LEADS].reset_index(drop=True)
    frame.insert(0, "suite", suite)
    remark = _LEGEND.format(marks="“ahead”: the first method is, “behind”: the second is,")
    return Table(spec.name, spec.title, frame, _layout, remark)


def _layout(leads: pd.DataFrame) -> Iterator[Block]:
    """Yield who is ahead at both ends of each family and where that changes, then all leads."""
    yield _LEGEND.format(marks="**Bold**: the first is ahead, *italic*: the second,")
    several = leads["class"].nunique() > 1
    for class_name, of_class in leads.groupby("class", sort=False):
        where = f", {class_name}" if several else ""
        yield f"## {markdown.cell(f'From end to end{where}')}"
        yield _summary(of_class, str(class_name))
        for name, of_family in of_class.groupby("family", sort=False):
            yield f"## {markdown.cell(FAMILY_BY_ID[str(name)].axis + where)}"
            yield _leads(of_family, str(class_name), FAMILY_BY_ID[str(name)])


_LEGEND = (
    "How much better the first method is than the second, over 0 if it is, [interval, paired over "
    "objects], failed images scored as blank ones. {marks} by an interval without 0; intervals of "
    "a metric hold in 95 % for all its cells together. Curves cross where the lead passes through "
    "0, on straight lines between what was measured (on the logarithm of the number of points and "
    "of the ratio of densities); in brackets as far as its interval holds 0."
)


def _shown_in_training(family: Family) -> str:
    """Return the range that networks were trained on: "splat-net@chair 512 to 2048"."""
    texts = []
    for name, least, most in family.trained:
        end = f"to {most:g}" if most > least else "only"
        texts.append(f"{name} {least:g} {end}")
    return ", ".join(texts)


def end_to_end_text(steps: Sequence[Mapping[str, Any]]) -> str:
    """Return who is ahead at the first and at the last step, and where the curves cross."""
    first, last = steps[0]["ahead"], steps[-1]["ahead"]
    ends = first if first == last else f"{first}, then {last}"
    crossings = [crossing_text(step) for step in steps if not math.isnan(step["crossing"])]
    if not crossings:
        return f"{ends}; none within"
    return f"{ends}; crosses at {' and '.join(crossings)}"


def crossing_text(step: Mapping[str, Any]) -> str:
    """Return where two curves cross, with three digits: "0.137 [0.12, 0.15]"."""

    def text(value: float) -> str:
        return f"{value:.0f}" if value >= 100 else f"{value:.3g}"

    at = text(step["crossing"])
    if not math.isfinite(step["crossing_low"]):
        return at
    return f"{at} [{text(step['crossing_low'])}, {text(step['crossing_high'])}]"


def _summary(leads: pd.DataFrame, class_name: str) -> Grid:
    """Return the pairs of methods along families down, metrics across."""
    rows = []
    for (*sides, metric), group in leads.groupby([*SIDES, "metric"], sort=False):
        steps = row_mappings(group)
        family, method, rival = sides
        rows.append(
            {
                "sides": tuple(sides),
                "family": family,
                "first": method,
                "second": rival,
                "metric": metric,
                "text": end_to_end_text(steps),
                "from": steps[0]["condition"],
                "to": steps[-1]["condition"],
            }
        )
    return pivot(
        pd.DataFrame(rows),
        line="sides",
        column="metric",
        cell=partial(_text_cell, column="text"),
        line_name=itemgetter("family"),
        before={
            name: partial(_text_cell, column=name) for name in ("from", "to", "first", "second")
        },
        corner="family",
        caption=f"from end to end, {class_name}",
    )


def _leads(leads: pd.DataFrame, class_name: str, family: Family) -> Grid:
    """Return the leads along one family, metrics down and steps across."""
    rows = [
        row | {"pair": (row["metric"], row["method"], row["rival"])} for row in row_mappings(leads)
    ]
    return pivot(
        pd.DataFrame(rows),
        line="pair",
        column="condition",
        cell=_lead,
        line_name=itemgetter("metric"),
        column_name=dict(zip(leads["condition"], leads["at"], strict=True)).__getitem__,
        before={
            "first": partial(_text_cell, column="method"),
            "second": partial(_text_cell, column="rival"),
        },
        corner="metric",
        caption=f"lead along {family.axis}, {class_name}",
        remark=f"In training: {_shown_in_training(family)}." if family.trained else "",
    )


def _text_cell(row: Mapping[str, Any], column: str) -> Cell:
    """Return the cell of a text in a column of the row."""
    return Cell(row[column])


def _lead(row: Mapping[str, Any]) -> Cell:
    """Return how much better the method is than its rival, marked by who is ahead."""
    method, rival = row["method"], row["rival"]
    special = None
    if row["ahead"] == method:
        special = AHEAD
    elif row["ahead"] == rival:
        special = BEHIND
    lead = row["lead"], row["ci_low"], row["ci_high"]
    return metric_cell(lead, row["metric"], method, rival, sign="+", special=special)
