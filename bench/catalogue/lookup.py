"""Finding an entry of a literal table by its id."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from typing import Protocol, TypeVar

from data_prep.failures import BadInput


class _HasId(Protocol):
    @property
    def id(self) -> str: ...


Entry = TypeVar("Entry", bound=_HasId)


def find(wanted: str, table: Sequence[Entry], kind: str) -> Entry:
    """The entry whose id is `wanted`. Raises BadInput that suggests the nearest and lists all."""
    for entry in table:
        if entry.id == wanted:
            return entry
    raise unknown(wanted, [entry.id for entry in table], kind)


def unknown(wanted: str, names: Sequence[str], kind: str) -> BadInput:
    """That there is nothing of this name: suggests the nearest and lists all."""
    near = difflib.get_close_matches(wanted, names, n=1, cutoff=0.4)
    hint = f"did you mean '{near[0]}'? " if near else ""
    return BadInput(f"unknown {kind} '{wanted}': {hint}there are {', '.join(names)}")
