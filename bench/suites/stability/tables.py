"""The matrix of the suite `stability`, cases by methods."""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import Any

from bench.suites.stability.expectations import KINDS
from bench.suites.stability.outcomes import CaseOutcome, Observation
from bench.tables.grid import BOLD, Block, Cell, Grid, grid, ordered
from bench.tables.markdown import cell
from bench.tables.table import Table, columns_of
from data_prep.failures import BadInput

NAME, TITLE = "stability_methods", "Methods at the extremes"


def matrix(remark: str, outcomes: Iterable[CaseOutcome]) -> Table[CaseOutcome]:
    """Return outcomes, a row each; for people `remark`, counts by kind, expected and observed."""
    layout = partial(_layout, remark)
    return Table.of_rows(NAME, TITLE, columns_of(CaseOutcome), tuple(outcomes), layout)


def subjects(table: Table[CaseOutcome]) -> list[str]:
    """Return the subjects in the order of their first appearance."""
    return ordered(outcome.subject for outcome in table.rows)


def unexpected(table: Table[CaseOutcome]) -> list[CaseOutcome]:
    """Return the outcomes that are none of the expected ones."""
    return [outcome for outcome in table.rows if outcome.kind == "unexpected"]


def counts(table: Table[CaseOutcome]) -> Grid:
    """Return the number of outcomes of each kind."""
    counter = Counter(outcome.kind for outcome in table.rows)
    return grid([*KINDS], [[str(counter[kind]) for kind in KINDS]])


def _layout(remark: str, outcomes: Sequence[CaseOutcome]) -> Iterator[Block]:
    counts = Counter(outcome.kind for outcome in outcomes)
    cases = len({(outcome.group, outcome.case) for outcome in outcomes})
    yield remark
    yield f"{cases} cases, {len(outcomes)} outcomes:"
    yield "\n".join(f"* **{kind}** {counts[kind]}: {about}" for kind, about in KINDS.items())
    for group in ordered(outcome.group for outcome in outcomes):
        yield f"## {cell(group)}"
        yield grid(
            ["case", "subject", "expected", "observed", ""],
            (
                [
                    *(o.case, o.subject, o.expected, o.observed),
                    Cell(o.kind, special=BOLD if o.kind == "unexpected" else None),
                ]
                for o in outcomes
                if o.group == group
            ),
        )


def read_outcomes(folder: Path) -> list[CaseOutcome]:
    """Return the outcomes of the matrix that a run has left in its folder of tables.

    Raises BadInput for a folder without it, and for a file that is none.
    """
    path = folder / f"{NAME}.csv"
    if not path.is_file():
        raise BadInput(f"{folder}: no tables of the suite stability; run it again")
    try:
        with path.open(encoding="utf-8", newline="") as file:
            reader = csv.DictReader(file)
            names, rows = reader.fieldnames, [dict[str, Any](row) for row in reader]
    except (UnicodeDecodeError, csv.Error):
        names, rows = None, []
    header = [field.name for field in fields(CaseOutcome)]
    if names != header or any(row["kind"] not in KINDS for row in rows):
        raise BadInput(f"{path}: not a table of this suite; run it again with --fresh")
    return [CaseOutcome(**row) for row in rows]


def observations_table(observations: Sequence[Observation]) -> Table[Observation]:
    """Return the numbers behind the matrix of methods, a row for each method and case."""
    return Table.of_rows("observations", "", columns_of(Observation, ".6g"), tuple(observations))
