from __future__ import annotations

import math
from dataclasses import dataclass

import pytest

from bench.analysis.comparison import NAN
from bench.tables.grid import (
    BOLD,
    Annotation,
    Cell,
    PivotLayout,
    grid,
    number,
    pivot,
    shown,
)
from bench.tables.markdown import document
from bench.tables.table import Table, columns, columns_of, constant, table_files


@dataclass(frozen=True)
class Measured:
    class_name: str
    method: str
    condition: str
    value: float
    n: int


ROWS = (
    Measured("chair", "a|b", "512", 0.5, 2),
    Measured("chair", "splat", "2048", 1 / 3, 1),
    Measured("chair", "splat", "512", NAN, 0),
)


def show(value):
    return f"{value:.2f}"


def made():
    return pivot(
        ROWS,
        "method",
        "condition",
        lambda row: number((row.value, 0.25, NAN), show, count=(row.n, 2)),
        PivotLayout(
            columns=("2048", "512"),
            before={"class": lambda row: Cell(row.class_name)},
            about=lambda rows: f"{len(rows)} rows",
        ),
        corner="method",
        notes=("why *not*",),
        remark="Of two_.",
    )


def test_csv_of_a_dataclass():
    table = Table("t", "T", (constant("suite", "s"), *columns_of(Measured, ".3g")), ROWS)
    assert table.to_csv() == (
        "suite,class,method,condition,value,n\n"
        "s,chair,a|b,512,0.5,2\ns,chair,splat,2048,0.333,1\ns,chair,splat,512,,0\n"
    )
    table = Table("t", "T", columns("n", ("first", "value")), ROWS[:1])
    assert table.to_csv() == "n,first\n2,0.500000\n"


def test_a_table_without_a_layout_is_for_scripts_alone():
    table = Table("t", "T", columns("n"), ROWS)
    assert list(table_files([table])) == ["t.csv"]
    assert table.grids() == ()
    made = Table("t", "T", columns("n"), ROWS, lambda rows: [f"{len(rows)} rows"])
    assert table_files([made])["t.md"] == "# T\n\n3 rows\n"


def test_marks_in_both_renderers():
    behind = Annotation("behind", "*{value}{interval}*", against=True)
    cells = [
        number((1.0, 0.5, 1.5), show, special=BOLD),
        number((1.0, 0.5, 1.5), show, special=behind),
        Cell("x", 1.0, count=(3, 4), blank="0.1", rest=", y"),
        Cell("x", count=(0, 4), blank="-"),
    ]
    (_, _, line) = document([grid(["", *"abcd"], [["l", *cells]])]).splitlines()
    assert line == "| l | **1.00** [0.50, 1.50] | *1.00 [0.50, 1.50]* | x 3/4 *b* 0.1, y | x 0/4 |"
    assert [cell.beside for cell in cells] == ["0.50 to 1.50", "0.50 to 1.50", ", y", ""]
    assert [cell.gap for cell in cells] == [
        *("", "behind", "3 of 4 images; 0.1 with blank ones for the others", "0 of 4 images"),
    ]


def test_what_was_not_measured_is_its_notes_alone():
    assert document([grid(["a"], [["x"]], notes=("skipped: why",), void=True)]) == "skipped: why\n"


@pytest.mark.parametrize(
    ("value", "decimals", "text"),
    [(-1e-9, 1, "0.0"), (-0.06, 1, "-0.1"), (0.0, 0, "0"), (1.25, 2, "1.25"), (math.nan, 3, "-")],
)
def test_numbers_for_people(value, decimals, text):
    assert shown(value, decimals) == text
