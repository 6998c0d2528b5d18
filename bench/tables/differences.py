"""The differences of two sides, as `bench compare` shows them, and of a method that was added."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from bench.analysis.compare import ALL
from bench.analysis.differences import INTERVAL_DECIMALS
from bench.analysis.digits import decimals, is_coarse
from bench.analysis.intervals import FEWEST, may_miss
from bench.analysis.pairs import IMAGES_OF, Differences, Standing, method_standing
from bench.analysis.run import Run
from bench.catalogue.conditions import condition_name
from bench.catalogue.metrics import higher_is_better
from bench.tables import markdown
from bench.tables.grid import (
    BOLD,
    DASH,
    FEWER,
    MOVED,
    Annotation,
    Block,
    Cell,
    marked,
    number_cell,
    number_text,
    ordered,
    pivot,
    row_mappings,
    scored_as_blank,
    unsure,
)
from bench.tables.markdown import visible
from bench.tables.table import Table
from bench.tables.terminal import in_parts, laid_out, value_text

Row = Mapping[str, Any]  # a row of `Differences.rows`

_MARKS = {
    "a": BOLD,
    "b": BOLD,
    "tie": Annotation("tie", "{value}{interval} ="),
    "same": Annotation("unchanged", "{value} unchanged"),
}
_TOO_FEW = Annotation("too few objects", "{value}{interval} ?")
# What is said of the second side, by who is ahead.
_WORDS = {
    "b": "better",
    "a": "worse",
    "tie": "not decided",
    "unknown": "undecided",
    "same": "unchanged",
}
_HINT = "Intervals: --format md"  # names the option of `bench compare` that prints them


def differences_table(differences: Differences) -> Table:
    """Return the table of a comparison, in which people see a grid for each metric and class."""
    title = f"{differences.b} against {differences.a}, scored against {differences.truth}"
    layout = partial(_layout, differences.remarks)
    return Table("differences", title, differences.rows, layout, hidden=IMAGES_OF)


def _layout(remarks: Sequence[str], differences: pd.DataFrame) -> Iterator[Block]:
    """Yield what the marks mean, the remarks, and a grid for each metric and class."""
    yield _legend(differences)
    yield from remarks
    if (differences["objects"] < FEWEST).any():
        yield f"Fewer than {FEWEST} objects have no interval, and show no difference."
    for (metric, class_name), of_grid in differences.groupby(["metric", "class"], sort=False):
        better = "higher" if higher_is_better(str(metric)) else "lower"
        yield f"## {markdown.cell(f'{metric}, {class_name}')} ({better} is better)"
        yield pivot(
            of_grid,
            line="method_b",
            column="condition",
            cell=difference_cell,
            corner="method",
            line_name=_methods,
            caption=f"{metric}, {class_name} ({better} is better)",
            interval="the interval of the difference",
        )


def _legend(differences: pd.DataFrame) -> str:
    """Return the meaning of the cells and of the marks that they can have."""
    legend = (
        "Each cell: value of a, value of b, and b - a with its interval, paired object by object, "
        "failed images scored as blank ones."
    )
    if differences["cells"].any():
        legend += (
            f" {_levels(differences)} **Bold**: the two differ, the interval leaves out 0. "
            "`=`: no difference is shown, it holds 0."
        )
    needed = differences["objects_needed"].dropna()
    if len(needed):
        legend += f" `?`: {too_few(needed.max())}."
    return legend


def _levels(differences: pd.DataFrame) -> str:
    """Return a sentence on the levels of the intervals that decide who is ahead."""
    several = differences["class"].nunique() > 1
    tested = row_mappings(differences[differences["cells"] > 0])
    parts = []
    for count, level, pooled in ordered(
        (row["cells"], row["level"], row["class"] == ALL) for row in tested
    ):
        part = f"{100 * level:.4g} %"
        if count > 1:
            part += f", which is 95 % for all {count} cells together"
        if several:
            part += " of all objects" if pooled else " of the classes"
        parts.append(part)
    return f"Intervals are of {'; and of '.join(parts)}."


def too_few(objects_needed: int) -> str:
    """Return the words for a comparison that has too few objects to be decided."""
    return f"too few objects to decide: at least {objects_needed}"


def _methods(row: Row) -> str:
    """Return the names of the methods that are compared: one where it is the same in two runs."""
    a, b = row["method_a"], row["method_b"]
    return b if a == b else f"{b} against {a}"


def difference_cell(row: Row) -> Cell:
    """Return both values and their difference with its interval; a dash where it has none."""
    if not math.isfinite(row["difference"]):
        return DASH
    metric, methods = row["metric"], _images_of(row)
    digits = decimals(metric, *methods)
    values = f"{number_text(row['value_a'], digits)} to {number_text(row['value_b'], digits)}: "
    who = _who(row)
    special = _TOO_FEW if row["objects_needed"] and who != "same" else _MARKS.get(who)
    low, high = row["ci_low"], row["ci_high"]
    if row["ahead"] in ("a", "b"):
        # The interval leaves out 0: it has as many digits as its nearer end needs not to print 0.
        nearer_end = min(abs(low), abs(high))
        while digits < INTERVAL_DECIMALS and not round(nearer_end, digits):
            digits += 1
    cell = number_cell((row["difference"], low, high), f"{{:+.{digits}f}}".format, special=special)
    images_failed = bool(row["failed_a"] or row["failed_b"])
    if may_miss(images_failed, row["objects"]):
        cell = unsure(cell)
    return marked(replace(cell, text=values + cell.text), metric, *methods)


def _who(row: Row) -> str:
    """Return who is ahead, or "same" where every object has the same value on both sides."""
    unequal = row["ci_low"] < 0 or row["ci_high"] > 0 or row["objects_needed"]
    return row["ahead"] if row["difference"] or unequal else "same"


def _images_of(row: Row) -> list[str]:
    """Return the methods that drew the images of both sides."""
    return [row[name] for name in IMAGES_OF]


def comparison_lines(differences: Differences, width: int, hint: str = _HINT) -> list[str]:
    """Return who is ahead by each criterion, in lines of at most `width` columns, the verdict last.

    Conditions stand side by side, in several parts where there is no room. The verdict ends with
    the `hint`.
    """
    rows = differences.rows
    a, b = visible(differences.a), visible(differences.b)
    by_class = rows.groupby("class", sort=False)["objects"].max()
    count = int(by_class.get(ALL, by_class.sum()))
    objects = "1 object" if count == 1 else f"{count} objects"
    several = len(by_class) > 1
    where = "" if several else f" ({visible(by_class.index[0])})"
    blocks: list[Any] = [
        f"{b} against {a} on {objects}{where}, paired",
        f"scored against {differences.truth}",
    ]
    conditions = rows["condition"].unique().tolist()
    of_runs = bool((rows["method_a"] == rows["method_b"]).any())
    for (method, class_name), of_block in rows.groupby(["method_b", "class"], sort=False):
        head = [str(method)] if of_runs else []
        if several:
            head.append(str(class_name))
        heads = [visible(", ".join(head))]
        heads += [condition_name(condition).brief for condition in conditions]
        blocks += ["", *in_parts(heads, list(_verdicts(of_block, conditions)), width)]
    if differences.remarks:
        blocks += ["", *(visible(remark.replace("`", "")) for remark in differences.remarks)]
    return laid_out([*blocks, "", _verdict(rows, b, objects, hint)], width)


def _verdicts(rows: pd.DataFrame, conditions: Sequence[str]) -> Iterator[list[str]]:
    """Yield two lines for each metric: who is ahead at each condition, and by how much."""
    for metric, of_metric in rows.groupby("metric", sort=False):
        valued = of_metric[np.isfinite(of_metric["difference"])]
        row_at = {row["condition"]: row for row in row_mappings(valued)}
        verdicts, leads = [str(metric)], ["  difference"]
        for condition in conditions:
            row = row_at.get(condition)
            verdicts.append(_WORDS[_who(row)] if row else "-")
            leads.append(_difference(row) if row else "-")
        yield verdicts
        yield leads


def _difference(row: Row) -> str:
    """Return the difference with its sign, without the 0 before the point: "-.012"."""
    metric, methods = row["metric"], _images_of(row)
    text = f"{row['difference']:+.{decimals(metric, *methods)}f}"
    text = re.sub(r"^([+-])0\.", r"\1.", text)
    return MOVED + text if is_coarse(metric, *methods) else text


def _verdict(rows: pd.DataFrame, name: str, objects: str, hint: str) -> str:
    """Return how often the second side is ahead: of all objects together, and class by class.

    name     of the second side
    objects  how many there are, in words
    hint     stands at the end
    """
    valued = rows[rows["difference"].notna()]
    valued = valued.assign(ahead=[_who(row) for row in row_mappings(valued)])
    if len(valued) and (valued["ahead"] == "same").all():
        return f"Unchanged in {_cells(len(valued))}."
    needed = valued["objects_needed"].dropna()
    if len(needed) == len(valued):
        decide = "decides" if objects == "1 object" else "decide"
        nothing = f"{objects} {decide} nothing here"
        if valued.empty:
            return f"{nothing}: no cell has a value on both sides."
        return f"{nothing}: at least {needed.max()} are needed."
    pooled = valued["class"] == ALL
    if pooled.any():
        sentences = [
            _count(valued[pooled], name, " of all objects"),
            _count(valued[~pooled], name, " of the classes"),
        ]
    else:
        sentences = [_count(valued, name)]
    if len(needed):
        sentences.append(f"Too few objects in {len(needed)}: at least {needed.max()} are needed.")
    if any(is_coarse(row["metric"], *_images_of(row)) for row in row_mappings(valued)):
        sentences.append(f"{FEWER}.")
    return " ".join(filter(None, (*sentences, hint)))


def _cells(count: int) -> str:
    return "1 cell" if count == 1 else f"{count} cells"


def _count(rows: pd.DataFrame, name: str, where: str = "") -> str:
    """Return by how many criteria the second side, `name`, is ahead, behind or neither."""
    counts = rows["ahead"].replace("unknown", "tie").value_counts()
    words = {"b": "ahead in", "a": "behind in", "tie": "not decided in", "same": "unchanged in"}
    told = ", ".join(f"{said} {counts[who]}" for who, said in words.items() if who in counts)
    of_cells = f"{_cells(len(rows))}{where}"
    corrected = f"(p < .05, corrected for {rows['cells'].max()})"
    if [*counts.index] == ["tie"]:
        return f"No difference is shown in {of_cells} {corrected}."
    return f"{name} is {told} of {of_cells} {corrected}."


def standing_lines(
    run: Run, headline: Table, method: str, added: Sequence[str], width: int
) -> Iterator[str]:
    """Yield how a method stands among those of its run, in lines of at most `width` columns.

    added  methods that were added together with it: it is not compared with them

    First come its values in the headline table, its place among the methods that compete, and the
    images that it lacks; then how it compares with the best of the other methods.
    """
    stands, name = method_standing(run, method, added), visible(method)
    yield ""
    if not stands.conditions:
        yield f"{name} has no image: there is nothing to compare."
        return
    lines = list(_values(headline, stands, method))
    heads = [name, *(condition_name(c).brief for c in stands.images), "place"]
    yield from laid_out([*in_parts(heads, lines, width), *_lacks(stands, name)], width)
    for metrics, differences in stands.against:
        yield ""
        if metrics:
            yield f"the best there by {' and '.join(metrics)}: {visible(differences.a)}"
        yield from comparison_lines(differences, width, hint="")
        pair = f"{differences.a},{method}"
        yield visible(f"intervals: bench compare {run.directory} --methods {pair} --format md")


def _values(headline: Table, stands: Standing, method: str) -> Iterator[list[str]]:
    """Yield a line for each metric: the values of a method at the conditions, and its place."""
    for grid in headline.grids():
        for line in grid.lines:
            if line.name != method:
                continue
            place, among = stands.places.get(grid.metric, (0, 0))
            yield [
                grid.metric,
                *(value_text(cell, True) for cell in line.cells),
                f"{_ordinal(place)} of {among}" if place else "-",
            ]


def _ordinal(place: int) -> str:
    """Return 1st, 2nd, 3rd, 4th; 11th, 12th and 13th."""
    if place % 100 in (11, 12, 13):
        return f"{place}th"
    ends = {1: "st", 2: "nd", 3: "rd"}
    return f"{place}{ends.get(place % 10, 'th')}"


def _lacks(stands: Standing, name: str) -> Iterator[str]:
    """Yield a line on the conditions without an image, and one for each that lacks some images."""
    has, every = stands.conditions, stands.images
    if len(has) < len(every):
        yield (
            f"{name} has {len(has)} of {len(every)} conditions: {', '.join(has)}. Places and "
            "comparisons here are of these; the tables score blank images at the others."
        )
    yield "place: by the mean over these conditions, among the methods that compete"
    for condition in has:
        if lacking := scored_as_blank(*every[condition]):
            yield f"{name} at {condition}: {lacking}."
