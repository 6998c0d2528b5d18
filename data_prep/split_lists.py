"""From what a split list names and what is on disk to the objects of each split.

The list decides what is measured: what it names and is not there becomes an object that fails with
"no such file", so that nothing is dropped in silence. What is there and not named is left out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from data_prep.scene_objects import Split

MOST_NAMED = 3


def listed(names: Sequence[str]) -> str:
    """Some names, for a line of a report."""
    more = len(names) - MOST_NAMED
    return ", ".join(names[:MOST_NAMED]) + (f" and {more} more" if more > 0 else "")


def differences(named: Mapping[Split, Sequence[str]], there: Sequence[str]) -> list[str]:
    """What list and disk do not agree on, a line each: `named` are the ids of each split."""
    on_disk, lines = set(there), []
    for split, ids in named.items():
        missing = [name for name in ids if name not in on_disk]
        if missing:
            lines.append(f"{len(missing)} of the split '{split}' are not there: {listed(missing)}")
    every = {name for ids in named.values() for name in ids}
    extra = sorted(on_disk - every)
    if extra:
        lines.append(f"{len(extra)} are in no split and left out: {listed(extra)}")
    return lines
