"""Finding an entry of a literal table by its id."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, TypeVar

from data_prep.failures import unknown


class _HasId(Protocol):
    @property
    def id(self) -> str: ...


Entry = TypeVar("Entry", bound=_HasId)


def find(wanted: str, table: Sequence[Entry], kind: str) -> Entry:
    """Return the entry whose id is `wanted`. Raises BadInput that suggests the nearest."""
    for entry in table:
        if entry.id == wanted:
            return entry
    raise unknown(wanted, [entry.id for entry in table], kind)
