"""What `bench compare` shows: the differences of two sides in a table, and in words."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import pandas as pd

from bench.analysis.comparison import ALL
from bench.analysis.digits import decimals, is_coarse
from bench.analysis.intervals import FEWEST, may_miss
from bench.analysis.paired import KEPT
from bench.analysis.run_pairs import MEASURED, Differences
from bench.catalogue.conditions import condition_name
from bench.catalogue.metrics import higher_is_better
from bench.tables import markdown
from bench.tables.grid import (
    BOLD,
    FEWER,
    MOVED,
    NOTHING,
    Annotation,
    Block,
    Cell,
    marked,
    number,
    ordered,
    pivot,
    records,
    shown,
    unsure,
)
from bench.tables.markdown import visible
from bench.tables.table import Table
from bench.tables.terminal import in_parts, laid_out

Row = Mapping[str, Any]  # of `Differences.cells`

_MARKS = {
    "a": BOLD,
    "b": BOLD,
    "tie": Annotation("tie", "{value}{interval} ="),
    "same": Annotation("unchanged", "{value} unchanged"),
}
_TOO_FEW = Annotation("too few objects", "{value}{interval} ?")
# The cell of the second side, by who is ahead.
_WORDS = {"b": "better", "a": "worse", "tie": "not decided", "unknown": "undecided"}
_WORDS |= {"same": "unchanged"}
_HINT = "Intervals: --format md"  # an option of `bench compare`


def differences_table(differences: Differences) -> Table:
    """Return a row for each cell; people see a grid for each metric and class."""
    title = f"{differences.b} against {differences.a}, scored against {differences.truth}"
    layout = partial(_layout, differences.remarks)
    return Table("differences", title, differences.cells, layout, hidden=MEASURED)


def _layout(remarks: Sequence[str], cells: pd.DataFrame) -> Iterator[Block]:
    yield _legend(cells)
    yield from remarks
    if (cells["objects"] < FEWEST).any():
        yield f"Fewer than {FEWEST} objects have no interval, and show no difference."
    for (metric, class_name), of_grid in cells.groupby(["metric", "class"], sort=False):
        better = "higher" if higher_is_better(str(metric)) else "lower"
        yield f"## {markdown.cell(f'{metric}, {class_name}')} ({better} is better)"
        yield pivot(
            *(of_grid, "method_b", "condition", difference_cell),
            corner="method",
            line_name=_methods,
            caption=f"{metric}, {class_name} ({better} is better)",
            interval="the interval of the difference",
        )


def _legend(cells: pd.DataFrame) -> str:
    """Return the meaning of the marks that the cells can have."""
    legend = (
        "Each cell: value of a, value of b, and b - a with its interval, paired object by object, "
        "failed images scored as blank ones."
    )
    if cells["cells"].any():
        legend += (
            f" {_levels(cells)} **Bold**: the two differ, the interval leaves out 0. "
            "`=`: no difference is shown, it holds 0."
        )
    needed = cells["objects_needed"].dropna()
    return legend + (f" `?`: {too_few(needed.max())}." if len(needed) else "")


def _levels(cells: pd.DataFrame) -> str:
    """Return a sentence on the intervals that decide."""
    several = cells["class"].nunique() > 1
    parts = [
        f"{100 * level:.4g} %"
        + (f", which is 95 % for all {count} cells together" if count > 1 else "")
        + (" of all objects" if pooled else " of the classes") * several
        for count, level, pooled in ordered(
            (row["cells"], row["level"], row["class"] == ALL)
            for row in records(cells[cells["cells"] > 0])
        )
    ]
    return f"Intervals are of {'; and of '.join(parts)}."


def too_few(objects_needed: int) -> str:
    """Return the words for a cell that so few objects cannot decide."""
    return f"too few objects to decide: at least {objects_needed}"


def _methods(row: Row) -> str:
    a, b = row["method_a"], row["method_b"]
    return b if a == b else f"{b} against {a}"


def difference_cell(row: Row) -> Cell:
    """Return both values and their difference with its interval; a dash where it has none."""
    if not math.isfinite(row["difference"]):
        return NOTHING
    metric, methods = row["metric"], _measured(row)
    digits = decimals(metric, *methods)
    values = f"{shown(row['value_a'], digits)} to {shown(row['value_b'], digits)}: "
    who = _who(row)
    special = _TOO_FEW if row["objects_needed"] and who != "same" else _MARKS.get(who)
    low, high = row["ci_low"], row["ci_high"]
    while (
        row["ahead"] in ("a", "b") and digits < KEPT and not round(min(abs(low), abs(high)), digits)
    ):
        digits += 1  # an interval that leaves out 0 does not print it
    cell = number((row["difference"], low, high), f"{{:+.{digits}f}}".format, special=special)
    images_failed = bool(row["failed_a"] or row["failed_b"])
    if may_miss(images_failed, row["objects"]):
        cell = unsure(cell)
    return marked(replace(cell, text=values + cell.text), metric, *methods)


def _who(row: Row) -> str:
    """Return who is ahead, "same" where each object has equal values on both sides."""
    unequal = row["ci_low"] < 0 or row["ci_high"] > 0 or row["objects_needed"]
    return row["ahead"] if row["difference"] or unequal else "same"


def _measured(row: Row) -> list[str]:
    """Return the methods whose images they are."""
    return [row[name] for name in MEASURED]


def comparison_lines(differences: Differences, width: int, hint: str = _HINT) -> list[str]:
    """Return who is ahead in each cell as lines of at most `width` columns, the verdict last.

    Conditions stand side by side, in several parts where they have no room. The verdict ends with
    the `hint`.
    """
    cells = differences.cells
    a, b = visible(differences.a), visible(differences.b)
    by_class = cells.groupby("class", sort=False)["objects"].max()
    count = int(by_class.get(ALL, by_class.sum()))
    objects = f"{count} object{'s' * (count != 1)}"
    several = len(by_class) > 1
    where = "" if several else f" ({visible(by_class.index[0])})"
    blocks: list[Any] = [
        f"{b} against {a} on {objects}{where}, paired",
        f"scored against {differences.truth}",
    ]
    conditions = cells["condition"].unique().tolist()
    of_runs = bool((cells["method_a"] == cells["method_b"]).any())
    for (method, class_name), of_block in cells.groupby(["method_b", "class"], sort=False):
        heads = [visible(", ".join([str(method)] * of_runs + [str(class_name)] * several))]
        heads += [condition_name(condition).brief for condition in conditions]
        blocks += ["", *in_parts(heads, list(_verdicts(of_block, conditions)), width)]
    if differences.remarks:
        blocks += ["", *(visible(remark.replace("`", "")) for remark in differences.remarks)]
    return laid_out([*blocks, "", _verdict(cells, b, objects, hint)], width)


def _verdicts(cells: pd.DataFrame, conditions: Sequence[str]) -> Iterator[list[str]]:
    """Yield two lines for each metric: who is ahead at each condition, and by how much."""
    for metric, of_metric in cells.groupby("metric", sort=False):
        at = {row["condition"]: row for row in records(of_metric)}
        known = [at.get(name, {"difference": math.nan}) for name in conditions]
        finite = [math.isfinite(row["difference"]) for row in known]
        pairs = list(zip(known, finite, strict=True))
        yield [str(metric), *(_WORDS[_who(row)] if ok else "-" for row, ok in pairs)]
        yield ["  difference", *(_difference(row) if ok else "-" for row, ok in pairs)]


def _difference(row: Row) -> str:
    metric, methods = row["metric"], _measured(row)
    text = f"{row['difference']:+.{decimals(metric, *methods)}f}"
    return MOVED * is_coarse(metric, *methods) + re.sub(r"^([+-])0\.", r"\1.", text)


def _verdict(cells: pd.DataFrame, name: str, objects: str, hint: str) -> str:
    """Return how often the second side, `name`, is ahead: of all objects, and of the classes."""
    valued = cells[cells["difference"].notna()]
    valued = valued.assign(ahead=[_who(row) for row in records(valued)])
    if len(valued) and (valued["ahead"] == "same").all():
        return f"Unchanged in {len(valued)} cell{'s' * (len(valued) != 1)}."
    needed = valued["objects_needed"].dropna()
    if len(needed) == len(valued):
        nothing = f"{objects} decide{'s' * objects.startswith('1 ')} nothing here"
        if valued.empty:
            return f"{nothing}: no cell has a value on both sides."
        return f"{nothing}: at least {needed.max()} are needed."
    whole = valued["class"] == ALL
    sentences = [_count(valued[whole], name, " of all objects")] if whole.any() else []
    sentences.append(_count(valued[~whole], name, " of the classes" * bool(sentences)))
    if len(needed):
        sentences.append(f"Too few objects in {len(needed)}: at least {needed.max()} are needed.")
    if any(is_coarse(row["metric"], *_measured(row)) for row in records(valued)):
        sentences.append(f"{FEWER}.")
    return " ".join(filter(None, (*sentences, hint)))


def _count(cells: pd.DataFrame, name: str, where: str) -> str:
    counts = cells["ahead"].replace("unknown", "tie").value_counts()
    words = {"b": "ahead in", "a": "behind in", "tie": "not decided in", "same": "unchanged in"}
    told = ", ".join(f"{said} {counts[who]}" for who, said in words.items() if who in counts)
    of_cells = f"{len(cells)} cell{'s' * (len(cells) != 1)}{where}"
    corrected = f"(p < .05, corrected for {cells['cells'].max()})"
    if [*counts.index] == ["tie"]:
        return f"No difference is shown in {of_cells} {corrected}."
    return f"{name} is {told} of {of_cells} {corrected}."
