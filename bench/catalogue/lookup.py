"""Ids: entries of literal tables by them, and the parts of a method's."""

from __future__ import annotations

from collections.abc import Sequence

from data_prep.failures import unknown
from data_prep.plugins import Entry


def find(wanted: str, table: Sequence[Entry], kind: str) -> Entry:
    """Return the entry whose id is `wanted`. Raises BadInput that suggests the nearest."""
    for entry in table:
        if entry.id == wanted:
            return entry
    raise unknown(wanted, [entry.id for entry in table], kind)


def family_of(method_id: str) -> str:
    """Return the id of a method without its variant: "splat-net" of "splat-net@grey"."""
    return method_id.partition("@")[0]


def variant_of(method_id: str) -> str:
    """Return the variant in an id: a name, PARAMETER=VALUE or a file of weights; "" for none."""
    return method_id.partition("@")[2]
