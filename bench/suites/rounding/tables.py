"""The tables of the suite `rounding`."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

from bench.analysis.significant_digits import ObjectDeviation, significant_digits
from bench.suites.rounding.deviations import GREY, Deviation, Move, StageDeviation
from bench.tables.grid import Block, Cell, PivotLayout, pivot
from bench.tables.table import Column, Table, columns_of

SHOWN = ("ssim", "ssim-object", "lpips", "fd-views")  # for people; CSV files have all metrics
OBJECTS = 24  # of the default run
THREE_DIGITS = ".3g"  # of deviations, which are known to a tenth or less


def deviations_table(rows: Sequence[Deviation]) -> Table[Deviation]:
    """Return the deviations in random rounding, which `results/rounding.csv` is a copy of."""

    def layout(rows: Sequence[Deviation]) -> Iterator[Block]:
        yield (
            "Standard deviation of the value of one object over repetitions in random rounding; of "
            "a mean over n objects it is the root of n times smaller. 0: no digit ever changes. In "
            f"brackets the digits of a mean over {OBJECTS} objects that survive."
        )
        yield from _grids(rows, "condition", lambda row: row.object_deviation, digits=True)

    columns = (
        *(
            replace(column, digits=".6g") if column.name == "value" else column
            for column in columns_of(Deviation, THREE_DIGITS)
        ),
        Column(f"digits_of_{OBJECTS}", _digits),
    )
    return Table("rounding", "Random rounding", columns, tuple(rows), layout)


def stages_table(rows: Sequence[StageDeviation]) -> Table[StageDeviation]:
    """Return the deviations by the stage that alone is rounded at random."""

    def layout(rows: Sequence[StageDeviation]) -> Iterator[Block]:
        yield "The same where one stage alone is rounded at random, and the input where it says so."
        for condition in dict.fromkeys(row.condition for row in rows):
            yield f"## {condition}"
            of_condition = [row for row in rows if row.condition == condition]
            yield from _grids(of_condition, "stage", lambda row: row.object_deviation)

    title = "Stages that lose the digits"
    columns = columns_of(StageDeviation, THREE_DIGITS)
    return Table("rounding_stages", title, columns, tuple(rows), layout)


def moves_table(rows: Sequence[Move]) -> Table[Move]:
    """Return the moves by directed modes, threads, batches and number formats."""

    def layout(rows: Sequence[Move]) -> Iterator[Block]:
        yield (
            "Moves from the plain arithmetic: `grey-levels` is the mean absolute difference of all "
            "pixels, 0..255, the others are the largest move of an object's value."
        )
        for condition in dict.fromkeys(row.condition for row in rows):
            yield f"## {condition}"
            of_condition = [row for row in rows if row.condition == condition]
            yield from _grids(
                of_condition,
                "arithmetic",
                lambda row: row.move if row.metric == GREY else row.largest,
                (GREY, *SHOWN),
            )

    title = "Directed modes, threads, batches and number formats"
    return Table("rounding_moves", title, columns_of(Move, THREE_DIGITS), tuple(rows), layout)


def _grids(
    rows: Sequence[Any],
    column: str,
    value: Callable[[Any], float],
    metrics: Sequence[str] = SHOWN,
    digits: bool = False,
) -> Iterator[Block]:
    """Yield a grid of methods by an attribute for each of some metrics."""
    for metric in metrics:
        of_metric = [row for row in rows if row.metric == metric]
        if of_metric:
            yield pivot(
                of_metric,
                "method",
                column,
                lambda row: Cell(
                    _short(value(row)) + (f" ({_digits(row)})" if digits else ""), value(row)
                ),
                PivotLayout(),
                corner="method",
                caption=metric,
            )


def _digits(row: Deviation) -> int | str:
    """Return the digits of a mean over OBJECTS that survive, or a dash where nothing is known."""
    half = ObjectDeviation(row.object_deviation, row.degrees).half_width(OBJECTS)
    survive = significant_digits(row.value, half)
    return "-" if survive is None else survive


def _short(value: float) -> str:
    return f"{value:.1e}" if value and math.isfinite(value) else "0" if value == 0 else "-"
