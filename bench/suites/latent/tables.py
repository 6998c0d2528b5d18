"""The tables of the suite `latent`: values of paths and sums, and their means."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bench.analysis.intervals import mean_interval
from bench.tables import markdown
from bench.tables.grid import Block, Cell, number, ordered, pivot
from bench.tables.table import Table, columns_of

ALL = "all"


@dataclass(frozen=True)
class LatentValue:
    """A measured number; NaN where it is undefined, as for a path without any move.

    what   the path, or the code that is compared with the right answer
    kind   the change of a triple; ALL for paths
    item   the pair or triple
    """

    method: str
    what: str
    kind: str
    item: str
    metric: str
    value: float


@dataclass(frozen=True)
class Mean:
    """The mean over pairs or triples, with a 95 % interval; `n_ok` of `n` have a value."""

    suite: str
    method: str
    what: str
    kind: str
    metric: str
    value: float
    ci_low: float
    ci_high: float
    n_ok: int
    n: int


def latent_table(
    name: str,
    title: str,
    remark: str,
    about: Mapping[str, str],
    subjects: Mapping[str, str],
    rows: Sequence[Mean],
) -> Table[Mean]:
    """Return a table of means with the text that readers need.

    about     text on each metric, by its id, in the order of the table
    subjects  text on each `what`, by its id, in the order of the table
    """

    def cell(row: Mean) -> Cell:
        if not row.n_ok:
            return Cell(f"- 0/{row.n}")
        count = f" {row.n_ok}/{row.n}" if row.n_ok < row.n else ""
        return number((row.value, row.ci_low, row.ci_high), "{:.3g}".format, rest=count)

    def layout(rows: Sequence[Mean]) -> Iterator[Block]:
        yield remark
        yield "\n".join(f"* **{subject}**: {message}" for subject, message in subjects.items())
        methods = ordered(row.method for row in rows)
        pairs = ordered((row.method, row.kind) for row in rows)
        for method, kind in sorted(pairs, key=lambda pair: methods.index(pair[0])):
            chosen = [row for row in rows if (row.method, row.kind) == (method, kind)]
            subject_cell = markdown.cell(method if kind == ALL else f"{method}, {kind} only")
            yield f"## {subject_cell} (n = {max(row.n for row in chosen)})"
            shown = {row.what for row in chosen}
            yield pivot(
                chosen,
                "metric",
                "what",
                cell,
                lines=about,
                columns=[subject for subject in subjects if subject in shown],
                missing=Cell(""),
            )
        yield "\n".join(f"* {metric}: {message}" for metric, message in about.items())

    return Table.of_rows(name, title, columns_of(Mean, ".6g"), tuple(rows), layout)


def values_table(name: str, values: Sequence[LatentValue]) -> Table[LatentValue]:
    """Return the single values behind a table, for scripts."""
    return Table.of_rows(name, "", columns_of(LatentValue, ".6g"), tuple(values))


def means(suite: str, values: Iterable[LatentValue]) -> tuple[Mean, ...]:
    """Return the mean of each method, subject, kind and metric, in the order of first values.

    Values of several kinds are also averaged over all of them.
    """
    groups: dict[tuple[str, str, str, str], list[float]] = {}
    for value in values:
        for kind in dict.fromkeys((ALL, value.kind)):
            key = (value.method, value.what, kind, value.metric)
            groups.setdefault(key, []).append(value.value)
    rows = []
    for (method, what, kind, metric), numbers in groups.items():
        finite = np.array([v for v in numbers if math.isfinite(v)])
        mean = float(finite.mean()) if len(finite) else float("nan")
        low, high = mean_interval(finite)
        rows.append(
            Mean(suite, method, what, kind, metric, mean, low, high, len(finite), len(numbers))
        )
    return tuple(sorted(rows, key=lambda row: row.kind != ALL))  # stable: all kinds come first
