"""Markdown tables of the studies."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from bench.tables.markdown import row


def markdown(head: Sequence[str], rows: Iterable[Sequence[str]], left: int = 1) -> str:
    """Return a Markdown table.

    head  the cells of the first line
    rows  the cells of the others, which are Markdown already
    left  the number of first columns that are set to the left, as names are; others have numbers
          and are set to the right
    """
    to_the_right = len(head) - left
    rule = "|" + "---|" * left + "---:|" * to_the_right
    return "\n".join([row(head), rule, *map(row, rows)]) + "\n"
