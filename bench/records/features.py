"""The features of a run, read class by class: all of them at once need not fit in memory.

`bench.records.parquet.write_features` writes the files so that a row group holds images of one
method, condition and class, and says in the footer of which; other row groups are not read.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from bench.records.seal import check_seal
from data_prep.arrays import Floats32
from data_prep.failures import BadInput

ImageKey = tuple[str, int]  # object, view
GROUP = ("method", "condition", "class")
VALUES = "features"


class Features(Protocol):
    """The features of one extractor by method, condition and class."""

    def images(self, method: str, condition: str, class_name: str) -> list[ImageKey]:
        """Return all images that have features, sorted; an empty list where none have."""
        ...

    def of(
        self, method: str, condition: str, class_name: str, images: Sequence[ImageKey]
    ) -> NDArray[Any]:
        """Return the features of `images`, [n, d]. Raises KeyError for an unknown image."""
        ...


class _Range(NamedTuple):
    """Smallest and largest value of a column in a row group."""

    low: str
    high: str


class FeatureFile:
    """The features in a Parquet file. In memory are its footer and the images asked for.

    All bytes are compared to their checksum first.

    `pyarrow.dataset` reads the same in half the code; it holds several row groups at a time, takes
    15 times the memory and is slower.
    """

    def __init__(self, path: Path) -> None:
        """Raise BadInput for a file that cannot be read."""
        self._path = path
        try:
            check_seal(path)
            self._footer = pq.read_metadata(path)
            arrow = self._footer.schema.to_arrow_schema()
        except (pa.ArrowException, OSError) as error:
            raise unreadable(self._path, error) from error
        if lacking := [n for n in (*GROUP, "object", "view", VALUES) if n not in arrow.names]:
            raise BadInput(f"{path}: no column {', '.join(lacking)}; start the run again")
        kind = arrow.field(VALUES).type
        self._width = int(getattr(kind, "list_size", 0))
        # Of variable length it is missing or -1.
        if self._width < 1 or not pa.types.is_floating(kind.value_type):
            raise BadInput(f"{path}: features of no fixed number; start the run again")
        self._of_group: dict[tuple[str, ...], list[int]] = {}  # row groups
        for number in range(self._footer.num_row_groups):
            ranges = [_range(self._footer, number, name) for name in GROUP]
            group = tuple(r.low for r in ranges if r is not None and r.low == r.high)
            if len(group) < len(GROUP):
                raise BadInput(
                    f"{path}: several methods, conditions or classes lie together, as in version "
                    "1.0.0 or earlier; start the run again"
                )
            self._of_group.setdefault(group, []).append(number)

    def images(self, method: str, condition: str, class_name: str) -> list[ImageKey]:
        """Return all images that have features, sorted; an empty list where none have.

        Raises BadInput for a file that cannot be read.
        """
        images: list[ImageKey] = []
        for table in self._read((method, condition, class_name), ("object", "view")):
            images += _images(table)
        return sorted(images)

    def of(
        self, method: str, condition: str, class_name: str, images: Sequence[ImageKey]
    ) -> Floats32:
        """Return the features of `images`, [n, d].

        Raises BadInput for a file that cannot be read, or lacks one of them or its values.
        """
        rows = {image: row for row, image in enumerate(dict.fromkeys(images))}
        values = np.empty((len(rows), self._width), np.float32)
        missing = set(rows)
        objects = _Range(min(images)[0], max(images)[0]) if images else _Range("", "")
        for table in self._read(
            (method, condition, class_name), ("object", "view", VALUES), objects
        ):
            stored = _images(table)
            wanted = [number for number, image in enumerate(stored) if image in rows]
            column = table.column(VALUES).combine_chunks()
            if column.null_count or column.flatten().null_count:
                break
            read = column.flatten().to_numpy().reshape(-1, self._width)
            values[[rows[stored[number]] for number in wanted]] = read[wanted]
            missing.difference_update(stored)
        if missing or not np.isfinite(values).all():
            first = min(missing or _not_finite(rows, values))
            whose = f"{method} at {condition}" if condition else method
            raise BadInput(
                f"{self._path}: no features of {whose} of {class_name}/{first[0]}, view "
                f"{first[1]}; start the run again with its command, which writes them anew"
            )
        return values if len(rows) == len(images) else values[[rows[image] for image in images]]

    def _read(
        self, group: tuple[str, str, str], columns: Sequence[str], objects: _Range | None = None
    ) -> Iterator[pa.Table]:
        """Yield the rows of a method, condition and class, one row group after the other.

        `objects` is the range of those wanted; row groups without any are not read.
        """
        numbers = [
            number
            for number in self._of_group.get(group, ())
            if objects is None or _overlap(_range(self._footer, number, "object"), objects)
        ]
        if not numbers:
            return
        try:
            with pq.ParquetFile(self._path, metadata=self._footer) as file:
                for number in numbers:
                    yield file.read_row_group(number, columns, use_threads=False)
        except (pa.ArrowException, OSError) as error:
            raise unreadable(self._path, error) from error


def _not_finite(rows: Mapping[ImageKey, int], values: Floats32) -> list[ImageKey]:
    return [image for image, row in rows.items() if not np.isfinite(values[row]).all()]


def unreadable(path: Path, error: Exception) -> BadInput:
    """Return the refusal of a Parquet file that Arrow cannot read."""
    # Arrow's messages may have several lines, and bytes of the file.
    reason = "".join(c if c.isprintable() else " " for c in str(error))
    return BadInput(f"{path}: not readable ({' '.join(reason.split())}); start the run again")


def _images(table: pa.Table) -> list[ImageKey]:
    objects, views = (table.column(name).to_pylist() for name in ("object", "view"))
    names = {name: name for name in objects}  # one string an object, not one a row
    return [(names[obj], view) for obj, view in zip(objects, views, strict=True)]


def _range(footer: Any, number: int, name: str) -> _Range | None:
    """Return the range of a column in a row group; None where the file does not say."""
    column = footer.schema.names.index(name)
    statistics = footer.row_group(number).column(column).statistics
    if statistics is None or not statistics.has_min_max:
        return None
    return _Range(statistics.min, statistics.max)


def may_hold(footer: Any, number: int, name: str, value: str) -> bool:
    """Return whether a row group may have a value in a column, by the statistics of the file."""
    return _overlap(_range(footer, number, name), _Range(value, value))


def _overlap(range_: _Range | None, other: _Range) -> bool:
    return range_ is None or (range_.low <= other.high and other.low <= range_.high)
