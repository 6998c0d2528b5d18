"""The tables of the suite `latent`: one value per path or sum, and their means.

Everything is one long list of `Value`s; a table is a pure function of them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import astuple, dataclass, fields

import numpy as np

from bench.analysis.intervals import mean_interval
from bench.tables import markdown
from bench.tables.table import csv_text

ALL = "all"


@dataclass(frozen=True)
class Value:
    """One number. NaN where there is none, a path that does not move say.

    what   the path, or what is compared with the expected answer
    kind   the change that a triple is about; ALL for paths
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


@dataclass(frozen=True)
class LatentTable:
    """Means with a title and what one has to know to read them.

    name      of its files, without suffix
    about     of each metric, by its id, in the order of the table
    subjects  of each `what`, by its id, in the order of the table
    """

    name: str
    title: str
    remark: str
    about: dict[str, str]
    subjects: dict[str, str]
    rows: tuple[Mean, ...]

    def to_csv(self) -> str:
        """Tidy: a row for each mean, 6 significant digits; an empty field where there is none."""
        return to_csv([f.name for f in fields(Mean)], self.rows)

    def to_markdown(self) -> str:
        """For people: metrics down, subjects across, a table for each method and kind."""
        lines = [f"# {self.title}", "", self.remark, ""]
        lines += [f"* **{subject}**: {about}" for subject, about in self.subjects.items()]
        lines += [""]
        for method in dict.fromkeys(row.method for row in self.rows):
            of_method = [row for row in self.rows if row.method == method]
            for kind in dict.fromkeys(row.kind for row in of_method):
                chosen = [row for row in of_method if row.kind == kind]
                title = markdown.cell(method if kind == ALL else f"{method}, {kind} only")
                lines += [f"## {title} (n = {max(row.n for row in chosen)})", ""]
                lines += [*self._grid(chosen), ""]
        lines += [f"* {metric}: {about}" for metric, about in self.about.items()]
        return "\n".join([*lines, ""])

    def _grid(self, rows: Sequence[Mean]) -> list[str]:
        at = {(row.metric, row.what): row for row in rows}
        whats = [what for what in self.subjects if any(row.what == what for row in rows)]
        lines = [
            "| | " + " | ".join(map(markdown.cell, whats)) + " |",
            "|---" * (len(whats) + 1) + "|",
        ]
        for metric in self.about:
            cells = [_cell(at.get((metric, what))) for what in whats]
            lines.append(markdown.row([markdown.cell(metric), *cells]))
        return lines


def means(suite: str, values: Iterable[Value]) -> tuple[Mean, ...]:
    """The mean of each method, subject, kind and metric, in the order of their first values.

    Values of several kinds are also averaged over all of them.
    """
    groups: dict[tuple[str, str, str, str], list[float]] = {}
    for value in values:
        for kind in dict.fromkeys((ALL, value.kind)):
            key = (value.method, value.what, kind, value.metric)
            groups.setdefault(key, []).append(value.value)
    made = []
    for (method, what, kind, metric), found in groups.items():
        finite = np.array([v for v in found if math.isfinite(v)])
        mean = float(finite.mean()) if len(finite) else float("nan")
        low, high = mean_interval(finite)
        made.append(
            Mean(suite, method, what, kind, metric, mean, low, high, len(finite), len(found))
        )
    return tuple(sorted(made, key=lambda row: row.kind != ALL))  # stable: all kinds come first


def values_to_csv(values: Sequence[Value]) -> str:
    """The single values behind the tables, tidy."""
    return to_csv([f.name for f in fields(Value)], values)


def to_csv(header: Sequence[str], rows: Iterable[Mean | Value]) -> str:
    """CSV of dataclasses, floats with 6 significant digits, an empty field for NaN."""
    return csv_text(header, ([_field(value) for value in astuple(row)] for row in rows))


def _field(value: object) -> object:
    if not isinstance(value, float):
        return value
    return f"{value:.6g}" if math.isfinite(value) else ""


def _cell(row: Mean | None) -> str:
    if row is None:
        return ""
    if not row.n_ok:
        return f"- 0/{row.n}"
    interval = f" [{row.ci_low:.3g}, {row.ci_high:.3g}]" if math.isfinite(row.ci_low) else ""
    count = f" {row.n_ok}/{row.n}" if row.n_ok < row.n else ""
    return f"{row.value:.3g}{interval}{count}"
