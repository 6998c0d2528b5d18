"""Shards: parts of a run that machines which share nothing make, under any scheduler.

Shard k of N has every Nth object of the run, beginning with the kth, so that all shards have about
as many objects of every class. `bench.running.merge` makes one run of them.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any, TypeVar

from data_prep.failures import BadInput

Element = TypeVar("Element")
WHOLE: str | None = None  # in the manifest of a run that is no shard


@dataclass(frozen=True)
class Shard:
    """Shard `number` (from 1) of `count` shards."""

    number: int
    count: int

    def __str__(self) -> str:
        return f"{self.number}/{self.count}"

    def select(self, elements: Sequence[Element]) -> tuple[Element, ...]:
        """Return the elements of this shard; none where there are fewer elements than shards."""
        return tuple(elements[self.number - 1 :: self.count])


def read_shard(text: str) -> Shard:
    """Return the shard with the name "k/N". Raises BadInput for any other text."""
    match = re.fullmatch(r"([0-9]{1,6})/([0-9]{1,6})", text)
    if match is not None:
        shard = Shard(int(match[1]), int(match[2]))
        if 1 <= shard.number <= shard.count:
            return shard
    raise BadInput(f"--shard {text}: give k/N, the kth of N parts, as in 1/4 ... 4/4")


def interleave(shards: Sequence[Sequence[Element]]) -> list[Element]:
    """Return the elements of shards 1 to N in the order they had before `Shard.select`.

    Raises ValueError where `Shard.select` cannot give such lengths: each shard has as many elements
    as the one before, or, once, one less.
    """
    total = sum(map(len, shards))
    positions = [Shard(k, len(shards)).select(range(total)) for k in range(1, len(shards) + 1)]
    if [*map(len, shards)] != [*map(len, positions)]:
        raise ValueError(f"{[*map(len, shards)]} elements are not interleaved")
    by_position = dict(zip(chain(*positions), chain(*shards), strict=True))
    return [by_position[position] for position in range(total)]


def objects_to_search(manifest: Mapping[str, Any]) -> int:
    """Return how many objects of a class include all objects of the run with this manifest."""
    name = manifest.get("shard")
    # In a run that was stopped, the complete objects need not be the first that were planned.
    count = max(len(manifest["objects"]), manifest.get("planned", 0))
    return count * (read_shard(name).count if name else 1)
