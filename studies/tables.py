"""Markdown tables of the studies."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from bench.tables.markdown import row


def markdown(head: Sequence[str], rows: Iterable[Sequence[str]], left: int = 1) -> str:
    """Return a table whose first `left` columns are names and the others numbers.

    Cells are Markdown already.
    """
    rule = "|" + "---|" * left + "---:|" * (len(head) - left)
    return "\n".join([row(head), rule, *map(row, rows)]) + "\n"
