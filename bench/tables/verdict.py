"""The text of `bench compare` on a terminal: who is ahead at each condition, and a verdict."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from rich.cells import cell_len, set_cell_size

from bench.analysis.comparison import ALL
from bench.analysis.digits import decimals, is_coarse
from bench.analysis.paired import Ahead, PairedDifference
from bench.analysis.run_pairs import Differences
from bench.catalogue.conditions import condition_name
from bench.tables.grid import FEWER, MOVED, ordered
from bench.tables.markdown import visible
from bench.tables.plain import GAP, in_groups
from bench.tables.wrap import wrapped

# The cell of the second method, by who is ahead.
WORDS: dict[Ahead, str] = {
    "b": "better",
    "a": "worse",
    "tie": "not decided",
    "unknown": "undecided",
}
NO_VALUE = "-"
HINT = "Intervals: --format md"  # an option of `bench compare`


class _Verdict(NamedTuple):
    """The cells of one metric in a row of conditions: words and differences."""

    metric: str
    words: tuple[str, ...]
    differences: tuple[str, ...]

    @property
    def lines(self) -> list[tuple[str, tuple[str, ...]]]:
        """Return the name and the cells of each line."""
        return [(self.metric, self.words), ("  difference", self.differences)]


def comparison_lines(differences: Differences, width: int, hint: str = HINT) -> list[str]:
    """Return a title, the truth, who is ahead in each cell, and the verdict as the last line.

    The verdict ends with the `hint`.
    Lines have at most `width` columns. Conditions stand side by side, in several parts where they
    have no room, and one below the other where not even one has.
    """
    unit, count = _unit(differences.cells)
    objects = f"{count} {_plural(unit)}" if count != 1 else f"1 {unit}"
    b, a = visible(differences.b), visible(differences.a)
    lines = wrapped(f"{b} against {a}, {objects}, paired by {unit}", width)
    lines += wrapped(f"scored against {differences.truth}", width)
    conditions = ordered(cell.pair.condition for cell in differences.cells)
    heads = [condition_name(condition).brief for condition in conditions]
    for corner, cells in _blocks(differences):
        rows = list(_verdicts(cells, conditions))
        lines += ["", *_laid_out(corner, heads, rows, width)]
    lines += [""] * bool(differences.remarks)
    for remark in differences.remarks:
        lines += wrapped(visible(remark.replace("`", "")), width)
    return [*lines, "", *wrapped(verdict(differences.cells, b, objects, hint), width)]


def verdict(cells: Sequence[PairedDifference], name: str, objects: str, hint: str = HINT) -> str:
    """Return one sentence or two on how often the second side, `name`, is ahead.

    Of all objects together and of the classes each have a sentence.
    """
    valued = [cell for cell in cells if math.isfinite(cell.difference.value)]
    needed = [cell.objects_needed for cell in valued if cell.objects_needed]
    if len(needed) == len(valued):
        nothing = f"{objects} decide{'s' * objects.startswith('1 ')} nothing here"
        if not valued:
            return f"{nothing}: no cell has a value on both sides."
        return f"{nothing}: at least {max(needed)} are needed."
    pooled = [cell for cell in valued if cell.pair.class_name == ALL]
    classes = [cell for cell in valued if cell.pair.class_name != ALL]
    sentences = [_count(pooled, name, " of all objects")] if pooled else []
    sentences.append(_count(classes, name, " of the classes" * bool(pooled)))
    if needed:
        sentences.append(f"Too few objects in {len(needed)}: at least {max(needed)} are needed.")
    if any(is_coarse(cell.pair.metric, *cell.pair.methods) for cell in valued):
        sentences.append(f"{FEWER}.")
    return " ".join(filter(None, (*sentences, hint)))


def _count(cells: Sequence[PairedDifference], name: str, where: str) -> str:
    counts = Counter(cell.ahead for cell in cells)
    undecided = counts["tie"] + counts["unknown"]
    parts = {"ahead in": counts["b"], "behind in": counts["a"], "not decided in": undecided}
    told = ", ".join(f"{words} {number}" for words, number in parts.items() if number)
    of_cells = f"{len(cells)} cell{'s' * (len(cells) != 1)}{where}"
    corrected = f"(p < .05, corrected for {max(cell.cells for cell in cells)})"
    if undecided == len(cells):
        return f"No difference is shown in {of_cells} {corrected}."
    return f"{name} is {told} of {of_cells} {corrected}."


def _unit(cells: Sequence[PairedDifference]) -> tuple[str, int]:
    """Return the unit of pairing, and how many there are."""
    objects: dict[str, int] = {}
    for cell in cells:
        name = cell.pair.class_name
        objects[name] = max(objects.get(name, 0), cell.pair.objects)
    if len(objects) != 1:
        return "object", objects.get(ALL, sum(objects.values()))
    ((name, count),) = objects.items()
    # The name of a folder of the user's may be no noun, or a plural.
    return (name if re.fullmatch("[a-z]*[a-rt-z]", name) else "object"), count


def _plural(noun: str) -> str:
    return noun + ("es" if re.search("(x|ch|sh)$", noun) else "s")


def _blocks(differences: Differences) -> Iterator[tuple[str, list[PairedDifference]]]:
    """Yield the cells of each class and two methods, with what tells them from the others."""
    cells = differences.cells
    keys = ordered((cell.pair.b.method, cell.pair.class_name) for cell in cells)
    several_classes = len({class_name for _, class_name in keys}) > 1
    of_runs = any(cell.pair.a.method == cell.pair.b.method for cell in cells)
    for method, class_name in keys:
        shown = [method] * of_runs + [class_name] * several_classes
        of_block = [
            cell
            for cell in cells
            if (cell.pair.b.method, cell.pair.class_name) == (method, class_name)
        ]
        yield visible(", ".join(shown)), of_block


def _verdicts(cells: Sequence[PairedDifference], conditions: Sequence[str]) -> Iterator[_Verdict]:
    for metric in ordered(cell.pair.metric for cell in cells):
        by_condition = {c.pair.condition: c for c in cells if c.pair.metric == metric}
        row = [by_condition.get(condition) for condition in conditions]
        yield _Verdict(metric, tuple(map(_word, row)), tuple(map(_difference, row)))


def _word(cell: PairedDifference | None) -> str:
    if cell is None or not math.isfinite(cell.difference.value):
        return NO_VALUE
    return WORDS[cell.ahead]


def _difference(cell: PairedDifference | None) -> str:
    if cell is None or not math.isfinite(cell.difference.value):
        return NO_VALUE
    metric, methods = cell.pair.metric, cell.pair.methods
    text = f"{cell.difference.value:+.{decimals(metric, *methods)}f}"
    return MOVED * is_coarse(metric, *methods) + re.sub(r"^([+-])0\.", r"\1.", text)


def _laid_out(corner: str, heads: Sequence[str], rows: Sequence[_Verdict], width: int) -> list[str]:
    """Return rows under the heads of their conditions, in as few parts as the width allows."""
    by_line = [line for row in rows for line in row.lines]
    names = [corner, *(name for name, _ in by_line)]
    wide = max(map(cell_len, names))
    columns = [[head, *(texts[i] for _, texts in by_line)] for i, head in enumerate(heads)]
    widths = [max(map(len, column)) for column in columns]
    if wide + len(GAP) + max(widths) > width:
        return _stacked(corner, heads, rows, width)
    if wide + len(columns) * (len(GAP) + max(widths)) <= width:
        widths = [max(widths)] * len(columns)
    columns = [[t.rjust(w) for t in texts] for texts, w in zip(columns, widths, strict=True)]
    first = [set_cell_size(name, wide) for name in names]
    lines: list[str] = []
    for part in in_groups(columns, width - wide - len(GAP)):
        lines += [""] * bool(lines)
        lines += (GAP.join(texts).rstrip() for texts in zip(first, *part, strict=True))
    return lines


def _stacked(corner: str, heads: Sequence[str], rows: Sequence[_Verdict], width: int) -> list[str]:
    """Return a line for each cell: for terminals with no room for a column beside the names."""
    lines = wrapped(corner, width)
    for row in rows:
        lines += wrapped(row.metric, width)
        for cell in zip(heads, row.words, row.differences, strict=True):
            lines += wrapped("  {}: {} {}".format(*cell), width, further="    ")
    return lines
