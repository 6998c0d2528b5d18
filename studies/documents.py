"""The tables of the documentation, filled with numbers from `results/docs`.

    python -m studies.documents [--check]

A place in a page is marked by two comments, and what stands between them is written anew:

    <!-- numbers: chairs-100.csv rows=method:pc2pix,splat columns=condition:2048,512 metric=ssim -->
    <!-- end -->

A file is what `bench table DIR --format csv` prints, or one of the files of a run or comparison; of
several, joined by commas, the lines stand together. `rows` and `columns` name a field and its
values in their order, or several fields, `metric:ssim,lpips*condition:2048,512`, and then all their
combinations; further `field=value` choose among the lines; `intervals=no` leaves intervals out, and
`show=paper` shows another field as it is. A difference is bold where p is below 0.05 after Holm's
correction, a method where it is on the frontier; italic is what is worse than a white image. Prints
how many numbers are generated, measured with date and commit, and settings, and fails where
`studies.provenance` knows no origin. `--check` changes nothing: it also fails where a page differs
from what would be written.
"""

from __future__ import annotations

import argparse
import csv
import re
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

from bench.analysis.comparison import decimals, milliseconds
from bench.analysis.paired import SIGNIFICANCE
from data_prep.files.atomic_write import write_whole
from studies.provenance import origins
from studies.tables import markdown

REPOSITORY = Path(__file__).parents[1]
NUMBERS = REPOSITORY / "results" / "docs"
PAGES = (
    REPOSITORY / "README.md",
    *sorted((REPOSITORY / "docs").glob("*.md")),
    *sorted((REPOSITORY / "pc2pix" / "weights").glob("*.md")),  # model cards
    *sorted((REPOSITORY / "baselines" / "splat_net" / "weights").glob("*.md")),
)
BEGIN, END = "<!-- numbers:", "<!-- end -->"
PLACE = re.compile(
    re.escape(BEGIN) + r"(?P<asked>[^>]*?)-->\n(?P<table>.*?)" + re.escape(END), re.S
)

Line = Mapping[str, str]
Axis = Sequence[tuple[str, Sequence[str]]]


class Unfilled(ValueError):
    """The error for a marked place that cannot be filled; it names page and line."""


@dataclass(frozen=True)
class TableRequest:
    """The request of a mark in a page.

    rows, columns  a field and its values; of several fields all combinations
    chosen         values of further fields
    shown          the field that cells show, as it is; empty: the value or the difference
    """

    files: Sequence[str]
    rows: Axis
    columns: Axis
    chosen: Mapping[str, str]
    intervals: bool
    shown: str


def parsed(asked: str) -> TableRequest:
    """Return the request of a mark.

    Raises ValueError for a mark without a file, rows or columns.
    """
    files, *words = asked.split()
    options = dict(word.split("=", 1) for word in words)
    intervals, shown = options.pop("intervals", "yes") == "yes", options.pop("show", "")
    fields = [
        [part.split(":", 1) for part in options.pop(name).split("*")]
        for name in ("rows", "columns")
    ]
    rows, columns = ([(field, values.split(",")) for field, values in axis] for axis in fields)
    return TableRequest(files.split(","), rows, columns, options, intervals, shown)


def filled(text: str, page: str, numbers: Path = NUMBERS) -> str:
    """Return the text of a page with the table of every marked place written anew.

    Raises Unfilled for a mark that is not understood, has no end or no source, or whose source has
    not exactly one line for a cell.
    """

    def table(mark: re.Match[str]) -> str:
        try:
            written = _table(parsed(mark["asked"]), numbers)
        except (ValueError, KeyError, OSError) as reason:
            raise Unfilled(f"{page}:{_line(text, mark.start())}: {reason}") from reason
        return f"{BEGIN}{mark['asked']}-->\n{written}{END}"

    whole = {mark.start() for mark in PLACE.finditer(text)}
    for mark in re.finditer(re.escape(BEGIN), text):
        if mark.start() not in whole:
            raise Unfilled(f"{page}:{_line(text, mark.start())}: a mark without '{END}'")
    return PLACE.sub(table, text)


def _line(text: str, place: int) -> int:
    return text.count("\n", 0, place) + 1


def _table(place: TableRequest, numbers: Path) -> str:
    lines = []
    for name in place.files:
        with (numbers / name).open(encoding="utf-8", newline="") as file:
            lines += [line for line in csv.DictReader(file) if _has(line, place.chosen)]
    columns = _combinations(place.columns)
    rows = [
        [*row.values(), *(_cell(_only(lines, {**row, **column}), place) for column in columns)]
        for row in _combinations(place.rows)
    ]
    heads = [" ".join(column.values()) for column in columns]
    corner = place.chosen.get("metric", place.rows[0][0].removesuffix("_b"))
    return markdown([corner, *[""] * (len(place.rows) - 1), *heads], rows, left=len(place.rows))


def _combinations(axis: Axis) -> list[dict[str, str]]:
    names = [field for field, _ in axis]
    return [
        dict(zip(names, values_of_fields, strict=True))
        for values_of_fields in product(*(values for _, values in axis))
    ]


def _only(lines: Sequence[Line], wanted: Mapping[str, str]) -> Line:
    matching = [line for line in lines if _has(line, wanted)]
    if len(matching) != 1:
        asked = ", ".join(f"{field} {value}" for field, value in wanted.items())
        raise ValueError(f"{len(matching)} lines with {asked}; there has to be one")
    return matching[0]


def _has(line: Line, wanted: Mapping[str, str]) -> bool:
    return all(line[field] == value for field, value in wanted.items())


def _cell(line: Line, place: TableRequest) -> str:
    if place.shown.endswith("_ms"):
        return milliseconds(float(line[place.shown]))
    if place.shown:
        return re.sub(r"(\.\d*?)0+$", r"\1", line[place.shown]).removesuffix(".") or "-"
    digits = decimals(line["metric"])
    differs = "difference" in line
    value = line["difference" if differs else "value"]
    if not value:
        return "-"
    text = _short(value, digits, sign=differs)
    p_value = line.get("p_holm")
    if line.get("verdict") == "frontier" or (p_value and float(p_value) < SIGNIFICANCE):
        text = f"**{text}**"
    if line.get("verdict") == "below a white image":
        text = f"*{text}*"
    if place.intervals and line["ci_low"]:
        low, high = (_short(line[end], digits, sign=differs) for end in ("ci_low", "ci_high"))
        text += f" [{low}, {high}]"
    return text


def _short(number: str, digits: int, sign: bool) -> str:
    """Return a number, rounded, without the 0 before the point of fractions."""
    text = f"{float(number):{'+' if sign else ''}.{digits}f}"
    return re.sub(r"^([+-]?)0\.", r"\1.", text).replace("-", "−")


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
