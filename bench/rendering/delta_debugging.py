"""Delta debugging: a small part of an input that still fails as the whole does.

Algorithm ddmin of Zeller and Hildebrandt, "Simplifying and isolating failure-inducing input", IEEE
Transactions on Software Engineering 28(2), 2002. Pure: how a part is tried is the caller's.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from hashlib import sha256

import numpy as np
from numpy.typing import NDArray

Rows = NDArray[np.intp]  # [n], ascending
FirstFailing = Callable[[Iterable[Rows]], Rows | None]


def ever_smaller(count: int, first_failing: FirstFailing) -> Iterator[Rows]:
    """Smaller and smaller sets of the rows 0 .. count - 1, which fail as all of them do.

    `first_failing` gives the first that fails of the sets that it is offered, or None; it may take
    several at once. No set is offered twice, and the empty one comes first. The last set yielded
    is 1-minimal: without any one of its rows it does not fail. It is the smallest where whatever
    contains a failing set fails too, and there is but one smallest; else there may be smaller ones.
    Nothing is yielded where all the rows are 1-minimal.
    """
    rows = np.arange(count)
    # Whatever was offered need not be offered again, even behind a set that failed: that is no
    # part of it, and all later ones are.
    offered = {_key(rows)}

    def first(candidates: Iterable[Rows]) -> Rows | None:
        return first_failing(_fresh(candidates, offered))

    if (empty := first([rows[:0]])) is not None:
        yield empty
        return
    chunks = _halved([rows])
    while True:
        if (part := first(chunks)) is not None:
            yield part
            rows, chunks = part, _halved([part])
        elif (rest := first(_without(rows, chunk) for chunk in chunks)) is not None:
            yield rest
            removed = int(np.argmin(np.isin([chunk[0] for chunk in chunks], rest)))
            rows, chunks = rest, chunks[removed + 1 :] + chunks[:removed]  # on from there
        elif len(chunks) < len(rows):
            chunks = _halved(chunks)
        else:
            return


def _fresh(candidates: Iterable[Rows], offered: set[bytes]) -> Iterator[Rows]:
    for rows in candidates:
        if (key := _key(rows)) not in offered:
            offered.add(key)
            yield rows


def _key(rows: Rows) -> bytes:
    return sha256(rows.tobytes()).digest()


def _halved(chunks: Sequence[Rows]) -> list[Rows]:
    return [half for chunk in chunks for half in np.array_split(chunk, 2) if len(half)]


def _without(rows: Rows, chunk: Rows) -> Rows:
    kept = np.ones(len(rows), bool)
    kept[np.searchsorted(rows, chunk)] = False
    return rows[kept]
