"""Cells of a run: the records of one method under one condition on one class."""

from __future__ import annotations

from collections.abc import Iterator

import pandas as pd

from bench.records.features import ImageKey

CellKey = tuple[str, str, str]  # method, condition, class


def cells(records: pd.DataFrame) -> Iterator[tuple[CellKey, pd.DataFrame]]:
    """Yield each cell with its records, in the order of the records."""
    groups = records.groupby(["method", "condition", "class"], sort=False)
    return (((str(m), str(c), str(k)), group) for (m, c, k), group in groups)  # type: ignore[misc]


def image_keys(records: pd.DataFrame) -> list[ImageKey]:
    """Return object and view of each record."""
    return list(zip(records["object"].tolist(), records["view"].tolist(), strict=True))
