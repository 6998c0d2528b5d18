"""Parts of a run that are made apart: on machines that share nothing, by any scheduler.

Shard k of N has every Nth object of the run, beginning with the kth, so that all shards have about
as much of every class. `bench.running.merge` puts them together.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from data_prep.failures import BadInput

Thing = TypeVar("Thing")
WHOLE: str | None = None  # stands in a manifest where a shard's name stands


@dataclass(frozen=True)
class Shard:
    """Number `number` (from 1) of `count`."""

    number: int
    count: int

    def __str__(self) -> str:
        return f"{self.number}/{self.count}"

    def of(self, things: Sequence[Thing]) -> tuple[Thing, ...]:
        """Those that are in this shard; none where there are fewer things than shards."""
        return tuple(things[self.number - 1 :: self.count])


def read_shard(text: str) -> Shard:
    """The shard with the name "k/N". Raises BadInput where that is none."""
    found = re.fullmatch(r"([0-9]{1,6})/([0-9]{1,6})", text)
    if found is not None:
        shard = Shard(int(found[1]), int(found[2]))
        if 1 <= shard.number <= shard.count:
            return shard
    raise BadInput(f"--shard {text}: give k/N, the kth of N parts, as in 1/4 ... 4/4")


def deal_back(shards: Sequence[Sequence[Thing]]) -> list[Thing]:
    """What was dealt to shards 1 to N, in the order that it had.

    Raises ValueError where no things can have been dealt so: each shard has as many as the one
    before, or, once, one less.
    """
    total = sum(map(len, shards))
    dealt = [Shard(k, len(shards)).of(range(total)) for k in range(1, len(shards) + 1)]
    if [*map(len, shards)] != [*map(len, dealt)]:
        raise ValueError(f"{[*map(len, shards)]} things were not dealt in turns")
    back: dict[int, Thing] = {}
    for places, things in zip(dealt, shards, strict=True):
        back |= zip(places, things, strict=True)
    return [back[place] for place in range(total)]


def objects_to_search(manifest: Mapping[str, Any]) -> int:
    """How far into its dataset a run with this manifest can have reached: a number of objects."""
    name = manifest.get("shard")
    return len(manifest["objects"]) * (read_shard(name).count if name else 1)
