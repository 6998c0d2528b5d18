"""The tables of the documentation, filled with numbers from `results/docs`.

    python -m studies.documents [--check]

A place in a page is marked by two comments, and what stands between them is written anew:

    <!-- numbers: chairs-100.csv rows=method:pc2pix,splat columns=condition:2048,512 metric=ssim -->
    <!-- end -->

The file is what `bench table DIR --format csv` prints, or one of the files of a run. `rows` and
`columns` name a field and its values in their order, or several fields,
`metric:ssim,lpips*condition:2048,512`, and then all their combinations; further `field=value`
choose among the lines; `intervals=no` leaves intervals out, and `show=paper` shows another field as
it is, `show=ahead` the verdict of a comparison. Values have the digits of the tables of runs
(`bench.analysis.digits`); one with fewer than its metric has is marked. Conditions stand in words,
"512 of 2,048 points". `best=yes` sets the best of each column of values in bold, several where
their digits do not tell them apart.

`marks=a-pc2pix.csv,a-splat-net@chair.csv` puts "better", "worse" or "not decided" beside values:
what the comparison of a row's method in those files says, after Holm's correction, at the same
metric, condition and class. A method without a comparison has no word. `marks=FILE;class:all` looks
under another class.

Columns with sources of their own are named one by one, in place of a file and `columns`:

    <!-- numbers: rows=method:pc2pix,best-classical
    column=real_objects;real.csv;metric:lpips;condition:2048
    column=one_view;cost.csv;show:cost_ms;best-classical:alpha-wrap
    column=trained_on;catalogue -->

`best-classical:alpha-wrap` shows the value of another method in that row; `catalogue` stands
for what `bench list` knows. A row that such a column has no line for gets a dash.

Prints how many numbers are generated, measured with date and commit, and settings. Fails where
`studies.provenance` knows no origin. `--check` changes nothing: it also fails where a page differs
from what would be written.
"""

from __future__ import annotations

import argparse
import csv
import re
import sys
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from itertools import product
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

from bench.analysis.comparison import milliseconds
from bench.analysis.digits import decimals, is_coarse, prints_better
from bench.catalogue.chosen import CHOSEN
from bench.catalogue.conditions import condition_name
from bench.catalogue.methods import find_method
from bench.catalogue.metrics import metric_facts
from bench.tables.grid import FEWER, MOVED
from data_prep.files.atomic_write import write_whole
from studies.provenance import origins
from studies.tables import markdown

REPOSITORY = Path(__file__).parents[1]
NUMBERS = REPOSITORY / "results" / "docs"
PAGES = (
    REPOSITORY / "README.md",
    *sorted((REPOSITORY / "docs").glob("*.md")),
    *sorted((REPOSITORY / "pc2pix" / "weights").glob("*.md")),  # model cards
    *sorted((REPOSITORY / "baselines").glob("*/weights/*.md")),
)
BEGIN, END = "<!-- numbers:", "<!-- end -->"
CATALOGUE, GAP = "catalogue", "–"
# of method b, which stands in the row, against method a
VERDICTS: Mapping[str, str] = {
    "a": "worse",
    "b": "better",
    "tie": "not decided",
    "unknown": "not decided",
}
_PLACE = re.compile(
    re.escape(BEGIN) + r"(?P<asked>[^>]*?)-->\n(?P<table>.*?)" + re.escape(END), re.S
)

Line = Mapping[str, str]


class Unfilled(ValueError):
    """The error for a marked place that cannot be filled; it names page and line."""


class _DocumentColumn(NamedTuple):
    """A column of a table, with its source."""

    head: str
    file: str  # a CSV file, or CATALOGUE
    wanted: Mapping[str, str]  # fields and values that choose among its lines
    shown: str = ""  # the field that cells show, as it is; empty: the value
    renamed: Mapping[str, str] = MappingProxyType({})  # by value of a row, what is looked up for it
    gaps: bool = False  # whether a row may have no line
    marks: str = ""  # CSV files of comparisons, whose verdicts stand beside the values
    marked: Mapping[str, str] = MappingProxyType({})  # in place of `wanted` for these lines


def _table(asked: str, numbers: Path) -> str:
    """Return the table of a mark.

    Raises ValueError or KeyError for a mark without a file, rows or columns.
    """
    words = asked.split()
    file = "" if "=" in words[0] else words.pop(0)
    options = [word.split("=", 1) for word in words]
    chosen = {name: text for name, text in options if name != "column"}
    intervals, shown = chosen.pop("intervals", "yes") == "yes", chosen.pop("show", "")
    best = chosen.pop("best", "no") == "yes"
    marks, *pairs = chosen.pop("marks", "").split(";")
    marked = dict(pair.split(":", 1) for pair in pairs)
    rows = _combinations(chosen.pop("rows"))
    columns = [_single_column(text.split(";"), rows) for name, text in options if name == "column"]
    columns = columns or [
        _DocumentColumn(
            ", ".join(_in_words(column)),
            file,
            chosen | column,
            shown,
            marks=marks,
            marked=marked,
        )
        for column in _combinations(chosen.pop("columns"))
    ]
    cells = [_cells(column, rows, intervals, numbers, best=best) for column in columns]
    fields = [*rows[0]]
    head = [chosen.get("metric", fields[0]), *[""] * (len(fields) - 1), *(c.head for c in columns)]
    body = [[*_in_words(row), *of_row] for row, *of_row in zip(rows, *cells, strict=True)]
    return markdown(head, body, len(fields))


def _single_column(parts: Sequence[str], rows: Sequence[Line]) -> _DocumentColumn:
    head, file, *rest = parts
    pairs = dict(part.split(":", 1) for part in rest)
    shown, values = pairs.pop("show", ""), {value for row in rows for value in row.values()}
    renamed = {name: pairs.pop(name) for name in [*pairs] if name in values}
    return _DocumentColumn(head.replace("_", " "), file, pairs, shown, renamed, gaps=True)


def _combinations(axis: str) -> list[dict[str, str]]:
    """Return the combinations of "field:value,value*field:value,value"."""
    fields = [part.split(":", 1) for part in axis.split("*")]
    names = [name for name, _ in fields]
    every = product(*(values.split(",") for _, values in fields))
    return [dict(zip(names, values, strict=True)) for values in every]


def _in_words(values: Mapping[str, str]) -> list[str]:
    """Return the values of a row or column as the table shows them."""
    return [
        _condition_in_words(value) if name == "condition" else value
        for name, value in values.items()
    ]


def _condition_in_words(condition: str) -> str:
    """Return a condition in words that are short enough for the head of a column."""
    name = condition_name(condition)
    shorter = {"missing": f"{name.short} missing", "density": f"density {name.short}"}
    return shorter.get(name.kind, name.words).replace(" %", "\N{NO-BREAK SPACE}%")


def filled(text: str, page: str, numbers: Path = NUMBERS) -> str:
    """Return the text of a page with the table of every marked place written anew.

    Raises Unfilled for a mark that is not understood, has no end or no source, or whose source has
    not exactly one line for a cell.
    """
    tables: list[str] = []

    def table(mark: re.Match[str]) -> str:
        try:
            written = _table(mark["asked"], numbers)
        except (ValueError, KeyError, OSError) as reason:
            raise Unfilled(f"{page}:{_line(text, mark.start())}: {reason}") from reason
        # The meaning stands once in a page, on the line of the end: pages are short.
        explained = MOVED in written and not any(MOVED in table for table in tables)
        tables.append(written)
        note = f"\n{FEWER}. " if explained else ""
        return f"{BEGIN}{mark['asked']}-->\n{written}{note}{END}"

    whole = {mark.start() for mark in _PLACE.finditer(text)}
    for mark in re.finditer(re.escape(BEGIN), text):
        if mark.start() not in whole:
            raise Unfilled(f"{page}:{_line(text, mark.start())}: a mark without '{END}'")
    return _PLACE.sub(table, text)


def _line(text: str, place: int) -> int:
    return text.count("\n", 0, place) + 1


def _cells(
    column: _DocumentColumn,
    rows: Sequence[Line],
    intervals: bool,
    numbers: Path,
    *,
    best: bool,
) -> list[str]:
    renamed = [
        {name: column.renamed.get(value, value) for name, value in row.items()} for row in rows
    ]
    if column.file == CATALOGUE:
        return [find_method(row["method"]).trained_on or GAP for row in renamed]
    lines = _read_lines([column.file], column.wanted, numbers)
    if column.gaps and not lines:
        raise ValueError(f"no line for the column '{column.head}'")
    verdicts = _read_lines(filter(None, column.marks.split(",")), column.marked, numbers)
    cells = []
    valued: dict[int, Line] = {}  # by place of their cell
    for row in renamed:
        matching = [line for line in lines if _has(line, row)]
        if not matching and column.gaps:
            cells.append(GAP)
            continue
        texts = {_cell(line, column.shown, intervals) for line in matching}
        if len(texts) != 1:  # lines of several tables of a run may repeat one
            asked = ", ".join(f"{name} {value}" for name, value in {**row, **column.wanted}.items())
            raise ValueError(f"{len(matching)} lines with {asked}; there has to be one")
        if not column.shown and matching[0]["value"]:
            valued[len(cells)] = matching[0]
        cells.append(f"{_mark(verdicts, row, column)} {texts.pop()}".strip())
    for place in _best(valued) if best else ():
        cells[place] = f"**{cells[place]}**"
    return cells


def _best(lines: Mapping[int, Line]) -> list[int]:
    """Return the places of the values that none is printed better than."""
    return [
        place
        for place, line in lines.items()
        if not any(_is_ahead(other, line) for other in lines.values())
    ]


def _is_ahead(line: Line, other: Line) -> bool:
    methods = (measured_method(line), measured_method(other))
    return prints_better(line["metric"], float(line["value"]), float(other["value"]), *methods)


def _read_lines(
    names: Iterable[str], wanted: Mapping[str, str], numbers: Path = NUMBERS
) -> list[Line]:
    """Return the lines of CSV files that have the wanted values.

    Raises OSError, and KeyError for a field that a file does not have.
    """
    lines: list[Line] = []
    for name in names:
        with (numbers / name).open(encoding="utf-8", newline="") as file:
            lines += [line for line in csv.DictReader(file) if _has(line, wanted)]
    return lines


def _mark(verdicts: Sequence[Line], row: Line, column: _DocumentColumn) -> str:
    """Return the verdict on the method of a row, or nothing without a comparison of it."""
    wanted = {**column.wanted, **row, **column.marked}
    wanted["method_b"] = wanted.pop("method", "")
    words = {
        VERDICTS[line["ahead"]]
        for line in verdicts
        if all(line.get(name, value) == value for name, value in wanted.items())
    }
    if len(words) > 1:
        raise ValueError(f"{row['method']} is {' and '.join(sorted(words))}; there has to be one")
    return "".join(words)


def _has(line: Line, wanted: Mapping[str, str]) -> bool:
    return all(line[name] == value for name, value in wanted.items())


def _cell(line: Line, shown: str, intervals: bool) -> str:
    if shown.endswith("_ms"):
        return milliseconds(float(line[shown]))
    if shown == "ahead":
        return VERDICTS[line[shown]]
    if shown:
        return re.sub(r"(\.\d*?)0+$", r"\1", line[shown]).removesuffix(".") or "-"
    metric, method = line["metric"], measured_method(line)
    if not line["value"]:
        return "-"
    # A metric of a suite with tables of its own has two digits that count.
    form = f".{decimals(metric, method)}f" if metric_facts(metric).kind else "#.2g"
    text = MOVED * is_coarse(metric, method) + _short(line["value"], form)
    if intervals and line["ci_low"]:
        low, high = (_short(line[end], form) for end in ("ci_low", "ci_high"))
        text += f" [{low}, {high}]"
    return text


def measured_method(line: Line) -> str:
    """Return the method of a value; of a chosen row the method that it is."""
    method = line.get("method", "")
    return line["note"].partition("; ")[0] if method in CHOSEN else method


def _short(number: str, form: str) -> str:
    """Return a number, rounded, without the 0 before the point of fractions."""
    return re.sub(r"^(-?)0\.", r"\1.", f"{float(number):{form}}").replace("-", "−")


def main() -> None:
    """Fill or check all pages."""
    parser = argparse.ArgumentParser(description="Tables of the documentation.")
    parser.add_argument("--check", action="store_true")
    options = parser.parse_args()
    stale, unknown = [], []
    counts: Counter[str] = Counter()
    for page in PAGES:
        text, name = page.read_text(encoding="utf-8"), str(page.relative_to(REPOSITORY))
        try:
            new = filled(text, name)
        except Unfilled as reason:
            sys.exit(str(reason))
        counted, lines = origins(new)
        counts.update(counted)
        unknown += [f"{name}:{line}: numbers without an origin" for line in lines]
        if new != text:
            stale.append(name)
            if not options.check:
                write_whole(page, new.encode())
    print(*(f"{count} {origin}" for origin, count in sorted(counts.items())), sep=", ")
    if unknown:
        sys.exit("\n".join(unknown))
    if options.check and stale:
        sys.exit(f"not what results/docs says: {', '.join(stale)}; run python -m studies.documents")


if __name__ == "__main__":
    main()
