"""The matrix of the suite `stability`, cases by methods."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd

from bench.suites.stability.expectations import KINDS
from bench.tables.grid import BOLD, Block, Cell, grid
from bench.tables.markdown import cell
from bench.tables.table import Table
from data_prep.failures import BadInput

NAME, TITLE = "stability_methods", "Methods at the extremes"
# Of a cell of the matrix: the case and its group, such as "outlier"; the method; both in words; the
# verdict, see `KINDS`. The cases of a group follow each other.
COLUMNS = ["case", "group", "subject", "expected", "observed", "kind"]


def matrix(remark: str, outcomes: pd.DataFrame) -> Table[Any]:
    """Return outcomes, a row each; for people `remark`, counts by kind, expected and observed."""
    return Table(NAME, TITLE, outcomes, partial(_layout, remark))


def _layout(remark: str, outcomes: pd.DataFrame) -> Iterator[Block]:
    counts = outcomes["kind"].value_counts()
    cases = outcomes.groupby(["group", "case"]).ngroups
    yield remark
    yield f"{cases} cases, {len(outcomes)} outcomes:"
    yield "\n".join(f"* **{kind}** {counts.get(kind, 0)}: {KINDS[kind]}" for kind in KINDS)
    for group, chosen in outcomes.groupby("group", sort=False):
        lines = [
            [*texts, Cell(kind, special=BOLD if kind == "unexpected" else None)]
            for *texts, kind in chosen.drop(columns="group").itertuples(index=False)
        ]
        yield f"## {cell(str(group))}"
        yield grid(["case", "subject", "expected", "observed", ""], lines)


def unexpected(outcomes: pd.DataFrame) -> list[str]:
    """Return a line for each outcome that is none of the expected ones."""
    rows = outcomes[outcomes["kind"] == "unexpected"].itertuples()
    return [f"{o.subject}, {o.case}: {o.observed}; stated was: {o.expected}" for o in rows]


def read_outcomes(folder: Path) -> pd.DataFrame:
    """Return the outcomes of the matrix that a run has left in its folder of tables.

    Raises BadInput for a folder without it, and for a file that is none.
    """
    path = folder / f"{NAME}.csv"
    if not path.is_file():
        raise BadInput(f"{folder}: no tables of the suite stability; run it again")
    try:
        outcomes = pd.read_csv(path, dtype=str, keep_default_na=False)
    except ValueError:  # not UTF-8, or no table
        outcomes = pd.DataFrame()
    if [*outcomes.columns] != COLUMNS or not outcomes["kind"].isin([*KINDS]).all():
        raise BadInput(f"{path}: not a table of this suite; run it again with --fresh")
    return outcomes
