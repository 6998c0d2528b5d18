"""Cells of a run: the records of one method under one condition on one class."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pandas as pd

from bench.records.features import ImageKey
from bench.records.parquet import read_records

CellKey = tuple[str, str, str]  # method, condition, class


def cells(records: pd.DataFrame) -> Iterator[tuple[CellKey, pd.DataFrame]]:
    """Yield each cell with its records, in the order of the records."""
    groups = records.groupby(["method", "condition", "class"], sort=False, observed=True)
    return (((str(m), str(c), str(k)), group) for (m, c, k), group in groups)  # type: ignore[misc]


def read_cell(directory: Path, cell: CellKey) -> pd.DataFrame:
    """Return object, view, direction and outcome of the images of a cell of a finished run."""
    columns = ("object", "view", "azimuth_deg", "elevation_deg", "outcome")
    only = dict(zip(("method", "condition", "class"), cell, strict=True))
    return read_records(directory, columns, **only)


def image_keys(records: pd.DataFrame) -> list[ImageKey]:
    """Return object and view of each record."""
    return list(zip(records["object"].tolist(), records["view"].tolist(), strict=True))
