"""The tables of the documentation, filled with numbers from `results/docs`.

    python -m studies.documents [--check]

A table stands between two comments in a page, and this study writes it anew:

    <!-- numbers: chairs-100.csv rows=method:pc2pix,splat columns=condition:2048,512 metric=ssim -->
    <!-- end -->

The first comment has a CSV file, which `bench table DIR --format csv` printed or which is one of
the files of a run, and options:

rows, columns  A field of the file and the values that the rows or columns of the table have. Of
               several fields, `metric:ssim,lpips*condition:2048,512`, all combinations are taken.
FIELD=VALUE    Only lines of the file with this value are used.
intervals=no   Confidence intervals are left out.
show=FIELD     Another field is shown in place of the value; `show=ahead` gives the verdict of a
               comparison in words.
best=yes       The best value of each column is set in bold, and all that round to it.
marks=FILES    "better", "worse" or "not decided" stands before each value. It is the outcome, after
               Bonferroni's correction, of the comparison of the row's method in these CSV files, at
               the same metric, condition and class. A method without a comparison has no word.
               `marks=FILE;class:all` looks at the comparisons of another class.

Values are rounded as in the tables of runs (`bench.analysis.digits`); a value with fewer digits
than others of its metric is marked. Conditions are written in words, "512 of 2,048 points".

A table whose columns have sources of their own names them one by one, in place of a file and
`columns`:

    <!-- numbers: rows=method:pc2pix,best-classical
    column=real_objects;real.csv;metric:lpips;condition:2048
    column=one_view;cost.csv;show:cost_ms;best-classical:alpha-wrap
    column=trained_on;catalogue -->

A column has a head, a file or several with commas, and pairs of fields and values.
`best-classical:alpha-wrap` shows, in the row of best-classical, the value of another method. The
file `catalogue` stands for what `bench list` knows of methods. Where such a column has no line for
a row, a dash is shown.

The study prints how many numbers of the pages are generated, are measured with date and commit, and
are settings. It fails where a number has none of these origins (`studies.provenance`). With
`--check` it changes nothing, and also fails where a page differs from what it would write.
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

from bench.analysis.compare import milliseconds
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
BEGIN, END = "<!-- numbers:", "<!-- end -->"  # of the comments around a table
CATALOGUE = "catalogue"  # stands in place of a file for what `bench list` knows
GAP = "–"  # shown where a column has no line for a row, or the line no value
# The field "ahead" of a comparison of methods a and b, in words about b, which is the row's method.
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
    """The error for a table that cannot be written; its message has page and line."""


class _DocumentColumn(NamedTuple):
    """A column of a table, with its source.

    head     its title
    file     CSV files, with commas, or CATALOGUE
    wanted   only lines of the file with these values of fields are used
    shown    the field that is shown as it is; "" for the value
    renamed  values of rows that are looked up under another value, with that value
    gaps     whether a row may have no line, and is shown as GAP
    marks    CSV files of comparisons, whose verdicts are shown before the values, with commas
    marked   values of fields by which comparisons are chosen, where they differ from `wanted`
    """

    head: str
    file: str
    wanted: Mapping[str, str]
    shown: str = ""
    renamed: Mapping[str, str] = MappingProxyType({})
    gaps: bool = False
    marks: str = ""
    marked: Mapping[str, str] = MappingProxyType({})


def _table(asked: str, numbers: Path) -> str:
    """Return the table that a comment asks for.

    Raises ValueError or KeyError for a comment without a file, rows or columns.
    """
    words = asked.split()
    file = "" if "=" in words[0] else words.pop(0)
    options = [word.split("=", 1) for word in words]
    chosen = {name: text for name, text in options if name != "column"}
    intervals = chosen.pop("intervals", "yes") == "yes"
    shown = chosen.pop("show", "")
    best = chosen.pop("best", "no") == "yes"
    marks, *pairs = chosen.pop("marks", "").split(";")
    marked = dict(pair.split(":", 1) for pair in pairs)
    rows = _combinations(chosen.pop("rows"))
    columns = [_single_column(text.split(";"), rows) for name, text in options if name == "column"]
    if not columns:
        for wanted in _combinations(chosen.pop("columns")):
            column = _DocumentColumn(
                head=", ".join(_in_words(wanted)),
                file=file,
                wanted=chosen | wanted,
                shown=shown,
                marks=marks,
                marked=marked,
            )
            columns.append(column)
    cells = [_cells(column, rows, intervals, numbers, best=best) for column in columns]
    # The values of rows stand in the first columns; only the first of these has a title.
    fields = list(rows[0])
    untitled = [""] * (len(fields) - 1)
    title = chosen.get("metric", fields[0])
    head = [title, *untitled, *(column.head for column in columns)]
    body = [[*_in_words(row), *of_row] for row, *of_row in zip(rows, *cells, strict=True)]
    return markdown(head, body, len(fields))


def _single_column(parts: Sequence[str], rows: Sequence[Line]) -> _DocumentColumn:
    """Return a column of the form "head;file;field:value;...", with its parts apart.

    A pair whose first word is a value of a row tells what is looked up for that row.
    """
    head, file, *rest = parts
    pairs = dict(part.split(":", 1) for part in rest)
    shown = pairs.pop("show", "")
    values_of_rows = {value for row in rows for value in row.values()}
    renamed = {name: pairs.pop(name) for name in list(pairs) if name in values_of_rows}
    return _DocumentColumn(
        head=head.replace("_", " "),
        file=file,
        wanted=pairs,
        shown=shown,
        renamed=renamed,
        gaps=True,
    )


def _combinations(axis: str) -> list[dict[str, str]]:
    """Return the combinations of values of fields, given as "field:value,value*field:value,value".

    The values of the last field change first.
    """
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
    """Return the text of a page in which all marked tables are written anew.

    page     name of the page, for messages
    numbers  the folder of the CSV files

    Raises Unfilled for a comment that is not understood or has no end, for a file that is missing,
    and where a file has no line or several different ones for a cell.
    """
    tables: list[str] = []

    def table(mark: re.Match[str]) -> str:
        try:
            written = _table(mark["asked"], numbers)
        except (ValueError, KeyError, OSError) as reason:
            raise Unfilled(f"{page}:{_line(text, mark.start())}: {reason}") from reason
        # What the mark of a value with fewer digits means is explained once in a page, after the
        # first table that has one.
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
    """Return the number of the line, from 1, that a place in a text is in."""
    return text.count("\n", 0, place) + 1


def _cells(
    column: _DocumentColumn,
    rows: Sequence[Line],
    intervals: bool,
    numbers: Path,
    *,
    best: bool,
) -> list[str]:
    """Return the cells of a column, one for each row."""
    renamed = []  # the rows with the values that are looked up
    for row in rows:
        renamed.append({name: column.renamed.get(value, value) for name, value in row.items()})
    if column.file == CATALOGUE:
        return [find_method(row["method"]).trained_on or GAP for row in renamed]
    lines = _read_lines(column.file.split(","), column.wanted, numbers)
    if column.gaps and not lines:
        raise ValueError(f"no line for the column '{column.head}'")
    verdicts = _read_lines(filter(None, column.marks.split(",")), column.marked, numbers)
    cells = []
    valued: dict[int, Line] = {}  # the lines whose values are shown, by the numbers of their rows
    for row in renamed:
        matching = [line for line in lines if _has(line, row)]
        if not matching and column.gaps:
            cells.append(GAP)
            continue
        texts = {_cell(line, column.shown, intervals) for line in matching}
        if len(texts) != 1:  # several lines may say the same, of several tables of a run
            asked = ", ".join(f"{name} {value}" for name, value in {**row, **column.wanted}.items())
            raise ValueError(f"{len(matching)} lines with {asked}; there has to be one")
        if not column.shown and matching[0]["value"]:
            valued[len(cells)] = matching[0]
        cells.append(f"{_mark(verdicts, row, column)} {texts.pop()}".strip())
    if best:
        for place in _best(valued):
            cells[place] = f"**{cells[place]}**"
    return cells


def _best(lines: Mapping[int, Line]) -> list[int]:
    """Return the keys of the lines whose values, as they are rounded, are the best."""
    best = []
    for place, line in lines.items():
        if not any(_is_ahead(other, line) for other in lines.values()):
            best.append(place)
    return best


def _is_ahead(line: Line, other: Line) -> bool:
    """Return whether the rounded value of a line is better than that of another."""
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
    """Return the verdict on the method of a row in words; "" without a comparison of it."""
    wanted = {**column.wanted, **row, **column.marked}
    wanted["method_b"] = wanted.pop("method", "")
    words = set()
    for line in verdicts:
        # Fields that a comparison does not have are no reason to pass over it.
        if all(line.get(name, value) == value for name, value in wanted.items()):
            words.add(VERDICTS[line["ahead"]])
    if len(words) > 1:
        raise ValueError(f"{row['method']} is {' and '.join(sorted(words))}; there has to be one")
    return "".join(words)


def _has(line: Line, wanted: Mapping[str, str]) -> bool:
    """Return whether a line has the wanted values; raise KeyError where it lacks a field."""
    return all(line[name] == value for name, value in wanted.items())


def _cell(line: Line, shown: str, intervals: bool) -> str:
    """Return what a table shows of a line: the field `shown`, or the value if that is "".

    intervals  whether the confidence interval of the value follows
    """
    if shown.endswith("_ms"):
        return milliseconds(float(line[shown]))
    if shown == "ahead":
        return VERDICTS[line[shown]]
    if shown:
        without_zeros = re.sub(r"(\.\d*?)0+$", r"\1", line[shown])
        return without_zeros.removesuffix(".") or GAP
    metric, method = line["metric"], measured_method(line)
    if not line["value"]:
        return GAP
    # Metrics of suites with tables of their own have no kind, and two significant digits.
    form = f".{decimals(metric, method)}f" if metric_facts(metric).kind else "#.2g"
    text = _short(line["value"], form)
    if is_coarse(metric, method):
        text = MOVED + text
    if intervals and line["ci_low"]:
        low, high = (_short(line[end], form) for end in ("ci_low", "ci_high"))
        text += f" [{low}, {high}]"
    return text


def measured_method(line: Line) -> str:
    """Return the method that a line's value was measured with.

    For a row such as `best-classical` it is the method that was chosen, which the note names.
    """
    method = line.get("method", "")
    if method in CHOSEN:
        return line["note"].partition("; ")[0]
    return method


def _short(number: str, form: str) -> str:
    """Return a number formatted by `form`, without a 0 before the decimal point."""
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
    print(", ".join(f"{count} {origin}" for origin, count in sorted(counts.items())))
    if unknown:
        sys.exit("\n".join(unknown))
    if options.check and stale:
        sys.exit(f"not what results/docs says: {', '.join(stale)}; run python -m studies.documents")


if __name__ == "__main__":
    main()
