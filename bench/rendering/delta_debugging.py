"""Delta debugging: algorithm ddmin of Zeller and Hildebrandt on the rows of an array.

"Simplifying and isolating failure-inducing input", IEEE Transactions on Software Engineering 28(2),
2002.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from hashlib import sha256

import numpy as np
from numpy.typing import NDArray

Rows = NDArray[np.intp]  # [n], ascending
FirstFailing = Callable[[Iterable[Rows]], Rows | None]


def ever_smaller(count: int, first_failing: FirstFailing) -> Iterator[Rows]:
    """Yield smaller and smaller sets of the rows 0 .. count - 1, which fail as all of them do.

    `first_failing` returns the first of the offered sets that fails, or None; it may try several at
    once. No set is offered twice, and the empty one comes first. The last set yielded is 1-minimal:
    without any one of its rows it does not fail. It is the smallest failing set where every set
    that contains a failing one fails too, and only one set is smallest; else smaller ones may
    exist. Nothing is yielded where all the rows are 1-minimal.
    """
    rows = np.arange(count)
    # A set once offered need not be offered again, even behind a set that failed: it is no part of
    # that, and all later ones are.
    offered = {_key(rows)}

    def first(candidates: Iterable[Rows]) -> Rows | None:
        return first_failing(fresh(candidates))

    def fresh(candidates: Iterable[Rows]) -> Iterator[Rows]:
        for candidate in candidates:
            if (key := _key(candidate)) not in offered:
                offered.add(key)
                yield candidate

    if (empty := first([rows[:0]])) is not None:
        yield empty
        return
    chunks = _halved([rows])
    while True:
        if (part := first(chunks)) is not None:
            yield part
            rows, chunks = part, _halved([part])
        elif (rest := first(np.setdiff1d(rows, chunk) for chunk in chunks)) is not None:
            yield rest
            removed = int(np.argmin(np.isin([chunk[0] for chunk in chunks], rest)))
            rows, chunks = rest, chunks[removed + 1 :] + chunks[:removed]  # on from there
        elif len(chunks) < len(rows):
            chunks = _halved(chunks)
        else:
            return


def _key(rows: Rows) -> bytes:
    return sha256(rows.tobytes()).digest()


def _halved(chunks: Sequence[Rows]) -> list[Rows]:
    return [half for chunk in chunks for half in np.array_split(chunk, 2) if len(half)]
