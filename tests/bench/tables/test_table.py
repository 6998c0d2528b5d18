from __future__ import annotations

import math

import pandas as pd
import pytest

from bench.analysis.compare import NAN
from bench.tables.grid import BOLD, Annotation, Cell, grid, number_cell, number_text, pivot
from bench.tables.markdown import document
from bench.tables.table import Table

COLUMNS = ["class", "method", "condition", "value", "n", "aside"]
FRAME = pd.DataFrame(
    [
        ("chair", "a|b", "512", 0.5, 2, "x"),
        ("chair", "splat", "2048", 1 / 3, 1, "y"),
        ("chair", "splat", "512", NAN, 0, "z"),
    ],
    columns=COLUMNS,
)


def show(value):
    return f"{value:.2f}"


def made():
    return pivot(
        FRAME,
        "method",
        "condition",
        lambda row: number_cell((row["value"], 0.25, 0.75), show, count=(row["n"], 2)),
        columns=("2048", "512"),
        before={"class": lambda row: Cell(row["class"])},
        about=lambda rows: f"{len(rows)} rows",
        corner="method",
        notes=("why *not*",),
        remark="Of two_.",
    )


def test_csv_and_rows_of_a_frame():
    table = Table("t", "T", FRAME, digits=".3g", hidden=("aside",))
    assert table.to_csv() == (
        "class,method,condition,value,n\n"
        "chair,a|b,512,0.5,2\nchair,splat,2048,0.333,1\nchair,splat,512,,0\n"
    )
    assert table.to_rows()[2] == {
        **{"class": "chair", "method": "splat", "condition": "512"},
        **{"value": None, "n": 0},
    }
    assert Table("t", "T", FRAME[["n", "value"]]).to_csv().splitlines()[1] == "2,0.500000"


def test_marks_in_both_renderers():
    behind = Annotation("behind", "*{value}{interval}*", against=True)
    cells = [
        number_cell((1.0, 0.5, 1.5), show, special=BOLD),
        number_cell((1.0, 0.5, 1.5), show, special=behind),
        Cell("x", 1.0, count=(3, 4), blank="0.1", rest=", y"),
        Cell("x", count=(0, 4), blank="-"),
    ]
    (_, _, line) = document([grid(["", *"abcd"], [["l", *cells]])]).splitlines()
    assert line == "| l | **1.00** [0.50, 1.50] | *1.00 [0.50, 1.50]* | x 3/4 *b* 0.1, y | x 0/4 |"
    assert [cell.beside for cell in cells] == ["0.50 to 1.50", "0.50 to 1.50", ", y", ""]
    assert [cell.gap for cell in cells] == [
        *("", "behind", "3 of 4 images; 0.1 with blank ones for the others", "0 of 4 images"),
    ]


@pytest.mark.parametrize(
    ("value", "decimals", "text"),
    [(-1e-9, 1, "0.0"), (-0.06, 1, "-0.1"), (0.0, 0, "0"), (1.25, 2, "1.25"), (math.nan, 3, "-")],
)
def test_numbers_for_people(value, decimals, text):
    assert number_text(value, decimals) == text
