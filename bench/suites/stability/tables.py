"""The matrices of the suite `stability`, cases x subjects, as CSV and as Markdown."""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Sequence
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from typing import Any

from bench.suites.stability.expectations import KINDS, Observation, Outcome
from bench.tables.markdown import cell
from bench.tables.table import csv_text
from data_prep.failures import BadInput


@dataclass(frozen=True)
class Matrix:
    """Outcomes with a title.

    name    of its files, without suffix
    remark  what people have to know to read it
    """

    name: str
    title: str
    remark: str
    outcomes: tuple[Outcome, ...]

    @property
    def subjects(self) -> tuple[str, ...]:
        """In the order of their first appearance."""
        return tuple(dict.fromkeys(outcome.subject for outcome in self.outcomes))

    @property
    def unexpected(self) -> tuple[Outcome, ...]:
        """What nobody has stated."""
        return tuple(outcome for outcome in self.outcomes if outcome.kind == "unexpected")

    def to_csv(self) -> str:
        """Tidy: a row for each outcome."""
        return to_csv([field.name for field in fields(Outcome)], self.outcomes)

    def to_markdown(self) -> str:
        """Counts by kind, then case by case what was expected and what came."""
        counts = Counter(outcome.kind for outcome in self.outcomes)
        cases = len({(outcome.group, outcome.case) for outcome in self.outcomes})
        lines = [
            f"# {self.title}",
            "",
            self.remark,
            "",
            f"{cases} cases, {len(self.outcomes)} outcomes:",
            "",
            *(f"* **{kind}** {counts[kind]}: {about}" for kind, about in KINDS.items()),
            "",
        ]
        for group in dict.fromkeys(outcome.group for outcome in self.outcomes):
            lines += [
                f"## {cell(group)}",
                "",
                "| case | subject | expected | observed | |",
                "|---|---|---|---|---|",
            ]
            for outcome in self.outcomes:
                if outcome.group == group:
                    kind = f"**{outcome.kind}**" if outcome.kind == "unexpected" else outcome.kind
                    texts = (outcome.case, outcome.subject, outcome.expected, outcome.observed)
                    lines.append(f"| {' | '.join(map(cell, texts))} | {kind} |")
            lines.append("")
        return "\n".join(lines)


def read_outcomes(folder: Path) -> list[Outcome]:
    """The outcomes of all matrices that a run has left in its folder of tables.

    Raises BadInput where there are none, or where a file is none of ours.
    """
    header = [field.name for field in fields(Outcome)]
    outcomes: list[Outcome] = []
    for path in sorted(folder.glob("stability_*.csv")):
        try:
            with path.open(encoding="utf-8", newline="") as file:
                reader = csv.DictReader(file)
                found, rows = reader.fieldnames, [dict[str, Any](row) for row in reader]
        except (UnicodeDecodeError, csv.Error):
            found, rows = None, []
        if found != header or any(row["kind"] not in KINDS for row in rows):
            raise BadInput(f"{path}: not a table of this suite; run it again with --fresh")
        outcomes += [Outcome(**row) for row in rows]
    if not outcomes:
        raise BadInput(f"{folder}: no tables of the suite stability; run it again")
    return outcomes


def observations_to_csv(observations: Sequence[Observation]) -> str:
    """The numbers behind the matrix of methods, a row for each method and case."""
    return to_csv([field.name for field in fields(Observation)], observations)


def to_csv(header: Sequence[str], rows: Sequence[Outcome] | Sequence[Observation]) -> str:
    """Numbers with 6 significant digits; an empty field where there is none."""
    return csv_text(
        header, ([f"{v:.6g}" if isinstance(v, float) else v for v in astuple(r)] for r in rows)
    )
