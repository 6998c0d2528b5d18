"""The leaderboard as plain values: one sorted table over all runs of a site.

`studies.leaderboard` makes the same of the project's own results.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

from bench.report.page import PageImage

RowKind = Literal["", "variant", "reference"]


@dataclass(frozen=True)
class BoardCell:
    """A cell of the leaderboard.

    Attributes
    ----------
    value : float or None
        Number that its column is sorted by; None comes last.
    letters : str
        Letters of a rank.
    title : str
        Words behind the letters, where the mouse rests on them.
    beneath : str
        Small words beneath the value.
    caveat : str
        Words that speak against the value.
    """

    text: str
    value: float | None = None
    letters: str = ""
    title: str = ""
    beneath: str = ""
    caveat: str = ""


EMPTY = BoardCell("–")


@dataclass(frozen=True)
class BoardColumn:
    """A column: its head, what the head means, where it leads, and how it is sorted."""

    name: str
    title: str = ""
    link: str = ""
    about: str = ""
    sort: Literal["number", "text"] = "number"
    higher: bool = False


@dataclass(frozen=True)
class BoardGroup:
    """Columns under one head; a group without a name has columns of their own."""

    columns: tuple[BoardColumn, ...]
    name: str = ""
    title: str = ""
    link: str = ""


@dataclass(frozen=True)
class BoardRow:
    """A method: its place among all that compete, and a cell for each column."""

    place: int | None
    name: str
    cells: tuple[BoardCell, ...]
    kind: RowKind = ""
    letters: str = ""
    about: str = ""
    link: str = ""
    thumbnail: PageImage | None = None


@dataclass(frozen=True)
class Board:
    """The leaderboard: rows in the order of their places, and notes on how to read it."""

    caption: str
    groups: tuple[BoardGroup, ...]
    rows: tuple[BoardRow, ...]
    notes: tuple[str, ...] = field(default=())

    @property
    def columns(self) -> list[BoardColumn]:
        """Return the columns of all groups."""
        return [column for group in self.groups for column in group.columns]

    def count(self, kind: RowKind) -> int:
        """Return the number of rows of a kind."""
        return sum(row.kind == kind for row in self.rows)

    @property
    def pictured(self) -> bool:
        """Return whether any method has a thumbnail."""
        return any(row.thumbnail for row in self.rows)


def row_kinds(
    ranked: Sequence[str], families: Sequence[str], references: set[str], shown: set[str]
) -> dict[str, RowKind]:
    """Return the kinds of methods, of which the best of each family is no variant.

    ranked, families  methods from the best on, and their families
    shown             methods that are no variant in any case
    """
    kinds: dict[str, RowKind] = {}
    seen: set[str] = set()
    for method, family in zip(ranked, families, strict=True):
        if method in references:
            kinds[method] = "reference"
        else:
            kinds[method] = "variant" if family in seen and method not in shown else ""
            seen.add(family)
    return kinds
