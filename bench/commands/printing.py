"""The tables of a run as commands print them."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence

from bench.commands.options import Format
from bench.commands.terminal import shown
from bench.report.build import REPORT
from bench.tables.build import Outputs
from bench.tables.latex import PREAMBLE
from bench.tables.markdown import visible
from bench.tables.table import TABLES, Table


def print_outputs(outputs: Outputs, format_: Format | None) -> None:
    """Print all tables of a run; without a format, the headline table and where the others are."""
    directory = outputs.run.directory
    if format_ is None:
        print("\n".join(shown(outputs.headline)))
        print(f"report: {directory / REPORT}\ntables: {directory / TABLES}")
    elif format_ is Format.md:
        parts = [table.to_markdown() for table in outputs.tables]
        parts.append(outputs.cost)
        parts += [table.to_markdown() for table in outputs.further]
        print("\n".join(parts))
    else:
        tables = [*outputs.tables, *outputs.further]
        if format_ is Format.latex:
            tables.insert(0, outputs.headline)
        print(in_format(tables, format_), end="")


def in_format(tables: Sequence[Table], format_: Format) -> str:
    """Return tables as one text.

    In CSV, tables with the same columns share a header, and an empty line stands before others.
    JSON is a list of tables with their rows, null for a missing value. Where stdout is a terminal,
    control characters in names are escaped: a name from a stranger's file could otherwise move the
    cursor or change the terminal's settings.
    """
    text = _in_format(tables, format_)
    return "\n".join(map(visible, text.split("\n"))) if sys.stdout.isatty() else text


def _in_format(tables: Sequence[Table], format_: Format) -> str:
    if format_ is Format.md:
        return "\n".join(table.to_markdown() for table in tables)
    if format_ is Format.latex:
        return "\n".join([PREAMBLE, *(table.to_latex() for table in tables)])
    if format_ is Format.json:
        listed = [
            {"name": table.name, "title": table.title, "rows": table.to_rows()} for table in tables
        ]
        return json.dumps(listed, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    rows: dict[str, list[str]] = {}
    for table in tables:
        header, _, values = table.to_csv().partition("\n")
        rows.setdefault(header, []).append(values)
    return "\n".join(f"{header}\n{''.join(values)}" for header, values in rows.items())
