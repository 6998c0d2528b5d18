"""The matrices of the suite `stability`: cases x subjects."""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import Any

from bench.suites.stability.expectations import KINDS, Observation, Outcome
from bench.tables.grid import BOLD, Block, Cell, Grid, grid, ordered
from bench.tables.markdown import cell
from bench.tables.table import Table, columns_of
from data_prep.failures import BadInput


def matrix(name: str, title: str, remark: str, outcomes: Iterable[Outcome]) -> Table[Outcome]:
    """Return outcomes, a row each; for people counts by kind, then expected and observed.

    `remark` is what people have to know to read it.
    """
    layout = partial(_layout, remark)
    return Table(name, title, columns_of(Outcome), tuple(outcomes), layout)


def subjects(made: Table[Outcome]) -> list[str]:
    """Return the subjects in the order of their first appearance."""
    return ordered(outcome.subject for outcome in made.rows)


def unexpected(made: Table[Outcome]) -> list[Outcome]:
    """Return the outcomes that nobody has stated."""
    return [outcome for outcome in made.rows if outcome.kind == "unexpected"]


def counts(matrices: Iterable[Table[Outcome]]) -> Grid:
    """Return how many outcomes of each kind every matrix has."""
    kinds = [(table.title, Counter(outcome.kind for outcome in table.rows)) for table in matrices]
    return grid(
        ["matrix", *KINDS], ([t, *(str(counter[kind]) for kind in KINDS)] for t, counter in kinds)
    )


def _layout(remark: str, outcomes: Sequence[Outcome]) -> Iterator[Block]:
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
                [o.case, o.subject, o.expected, o.observed, _kind(o)]
                for o in outcomes
                if o.group == group
            ),
        )


def _kind(outcome: Outcome) -> Cell:
    return Cell(outcome.kind, special=BOLD if outcome.kind == "unexpected" else None)


def read_outcomes(folder: Path) -> list[Outcome]:
    """Return the outcomes of all matrices that a run has left in its folder of tables.

    Raises BadInput where there are none, or where a file is none of ours.
    """
    header = [field.name for field in fields(Outcome)]
    outcomes: list[Outcome] = []
    for path in sorted(folder.glob("stability_*.csv")):
        try:
            with path.open(encoding="utf-8", newline="") as file:
                reader = csv.DictReader(file)
                names, rows = reader.fieldnames, [dict[str, Any](row) for row in reader]
        except (UnicodeDecodeError, csv.Error):
            names, rows = None, []
        if names != header or any(row["kind"] not in KINDS for row in rows):
            raise BadInput(f"{path}: not a table of this suite; run it again with --fresh")
        outcomes += [Outcome(**row) for row in rows]
    if not outcomes:
        raise BadInput(f"{folder}: no tables of the suite stability; run it again")
    return outcomes


def observations_table(observations: Sequence[Observation]) -> Table[Observation]:
    """Return the numbers behind the matrix of methods, a row for each method and case."""
    return Table("observations", "", columns_of(Observation, ".6g"), tuple(observations))
