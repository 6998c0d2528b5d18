"""The leaderboard as plain values: one sorted table over all runs of a site.

`studies.leaderboard` makes the same of the project's own results.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, field
from typing import Literal

from bench.catalogue.lookup import family_of
from bench.catalogue.methods import role
from bench.report.page import PageImage

RowKind = Literal["", "variant", "reference"]
REFERENCES = ("floor", "ceiling")  # roles


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


def fraction(value: float, digits: int) -> str:
    """Return a number without the 0 before the point."""
    text = f"{value:.{digits}f}"
    return text.removeprefix("0") if text.startswith("0.") else text.replace("-0.", "−.")


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

    @property
    def starts(self) -> list[int]:
        """Return the columns at which a group begins."""
        sizes = [len(group.columns) for group in self.groups]
        return [sum(sizes[:i]) for i in range(len(sizes))]

    def count(self, kind: RowKind) -> int:
        """Return the number of rows of a kind."""
        return sum(row.kind == kind for row in self.rows)

    @property
    def pictured(self) -> bool:
        """Return whether any method has a thumbnail."""
        return any(row.thumbnail for row in self.rows)


def row_kinds(
    ranked: Sequence[str], ids: Mapping[str, str], always: AbstractSet[str]
) -> dict[str, RowKind]:
    """Return the kinds of methods by their names; `ids` are those of the catalogue.

    An id with a variant is one, but for the best of a family without a plain method, and for those
    of `always`.
    """
    plain = {family_of(ids[m]) for m in ranked if ids[m] == family_of(ids[m])}
    kinds: dict[str, RowKind] = {}
    for method in ranked:
        family = family_of(ids[method])
        if role(ids[method]) in REFERENCES:
            kinds[method] = "reference"
        elif ids[method] == family or ids[method] in always or family not in plain:
            kinds[method] = ""
            plain.add(family)
        else:
            kinds[method] = "variant"
    return kinds
