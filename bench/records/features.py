"""The features that a run has kept, read cell by cell: all of them at once need not fit in memory.

A cell is one method's images of one class under one condition. The files are written cell by cell
(`bench.records.parquet.write_features`), a row group holding images of one cell only, and every
row group says what cells and objects are in it; so what is asked for is read, and nothing else.
Files in another order are read as well, more slowly.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from bench.records.artifacts import Artifact
from data_prep.failures import BadInput

ImageKey = tuple[str, int]  # object, view
CELL = ("method", "condition", "class")
VALUES = "features"


class Features(Protocol):
    """The features of one extractor by (method, condition, class), each a set of images."""

    def images(self, method: str, condition: str, class_name: str) -> list[ImageKey]:
        """The images there are, sorted; none in a cell that is not there."""
        ...

    def of(
        self, method: str, condition: str, class_name: str, images: Sequence[ImageKey]
    ) -> NDArray[Any]:
        """Theirs [n, d], in the order of `images`. Raises KeyError for one that is not there."""
        ...


class ArtifactFeatures:
    """The features in the artifacts of a run that goes on; each array is read when asked for."""

    def __init__(self, extractor: str, artifacts: Sequence[Artifact], views: int) -> None:
        self._extractor, self._views = extractor, views
        self._cells: dict[tuple[str, str, str], dict[str, Artifact]] = {}
        for artifact in artifacts:
            *cell, obj = artifact.item
            self._cells.setdefault((cell[0], cell[1], cell[2]), {})[obj] = artifact

    def images(self, method: str, condition: str, class_name: str) -> list[ImageKey]:
        """The images there are, sorted; none in a cell that is not there."""
        objects = sorted(self._cells.get((method, condition, class_name), ()))
        return [(obj, view) for obj in objects for view in range(self._views)]

    def of(
        self, method: str, condition: str, class_name: str, images: Sequence[ImageKey]
    ) -> NDArray[Any]:
        """Theirs [n, d], in the order of `images`. Raises KeyError for one that is not there."""
        there = self._cells.get((method, condition, class_name), {})
        read = {obj: there[obj].array(self._extractor) for obj in {obj for obj, _ in images}}
        return np.stack([read[obj][view] for obj, view in images])


class _Span(NamedTuple):
    """Smallest and largest value of a column in a row group; None where the file does not say."""

    low: str
    high: str


class FeatureFile:
    """The features in a Parquet file. In memory are its footer, and the cell that is read."""

    def __init__(self, path: Path) -> None:
        """Raises BadInput for a file that cannot be read."""
        self._path = path
        try:
            self._footer = pq.read_metadata(path)
            arrow = self._footer.schema.to_arrow_schema()
        except (pa.ArrowException, OSError) as error:
            raise self._unreadable(error) from error
        if lacking := [n for n in (*CELL, "object", "view", VALUES) if n not in arrow.names]:
            raise BadInput(f"{path}: no column {', '.join(lacking)}; start the run again")
        self._width = int(getattr(arrow.field(VALUES).type, "list_size", 0))
        if self._width < 1:  # of variable length, or -1
            raise BadInput(f"{path}: features of no fixed number; start the run again")
        self._spans = [
            {name: _span(self._footer, group, name) for name in (*CELL, "object")}
            for group in range(self._footer.num_row_groups)
        ]

    def images(self, method: str, condition: str, class_name: str) -> list[ImageKey]:
        """The images there are, sorted; none in a cell that is not there. Raises BadInput."""
        found: list[ImageKey] = []
        for table in self._read((method, condition, class_name), ("object", "view")):
            found += _images(table)
        return sorted(found)

    def of(
        self, method: str, condition: str, class_name: str, images: Sequence[ImageKey]
    ) -> NDArray[np.float32]:
        """Theirs [n, d], in the order of `images`.

        Raises KeyError for one that is not there, and BadInput for a file that cannot be read.
        """
        places = {image: place for place, image in enumerate(dict.fromkeys(images))}
        values = np.empty((len(places), self._width), np.float32)
        missing = set(places)
        objects = _Span(min(images)[0], max(images)[0]) if images else _Span("", "")
        for table in self._read(
            (method, condition, class_name), ("object", "view", VALUES), objects
        ):
            here = _images(table)
            rows = [row for row, image in enumerate(here) if image in places]
            column = table.column(VALUES).combine_chunks()
            read = column.flatten().to_numpy().reshape(-1, self._width)
            values[[places[here[row]] for row in rows]] = read[rows]
            missing.difference_update(here)
        if missing:
            raise KeyError(min(missing))
        return values if len(places) == len(images) else values[[places[p] for p in images]]

    def _read(
        self, cell: tuple[str, str, str], columns: Sequence[str], objects: _Span | None = None
    ) -> Iterator[pa.Table]:
        """Row group by row group, the rows of a cell; `objects` are the first and last wanted."""
        spans = {name: _Span(value, value) for name, value in zip(CELL, cell, strict=True)}
        wanted = spans if objects is None else spans | {"object": objects}
        groups = [
            group
            for group, there in enumerate(self._spans)
            if all(_meet(there[name], span) for name, span in wanted.items())
        ]
        if not groups:
            return
        try:
            with pq.ParquetFile(self._path, metadata=self._footer) as file:
                for group in groups:
                    table = file.read_row_group(group, [*CELL, *columns], use_threads=False)
                    if any(self._spans[group][name] != spans[name] for name in CELL):
                        there = zip(*(table.column(name).to_pylist() for name in CELL), strict=True)
                        rows = [row for row, of in enumerate(there) if of == cell]
                        table = table.take(pa.array(rows, pa.int64()))
                    yield table
        except (pa.ArrowException, OSError) as error:
            raise self._unreadable(error) from error

    def _unreadable(self, error: Exception) -> BadInput:
        return BadInput(f"{self._path}: not readable ({error}); start the run again")


def _images(table: pa.Table) -> list[ImageKey]:
    objects, views = (table.column(name).to_pylist() for name in ("object", "view"))
    names = {name: name for name in objects}  # one string an object, not one a row
    return [(names[obj], view) for obj, view in zip(objects, views, strict=True)]


def _span(footer: Any, group: int, name: str) -> _Span | None:
    number = footer.schema.names.index(name)
    statistics = footer.row_group(group).column(number).statistics
    if statistics is None or not statistics.has_min_max:
        return None
    return _Span(statistics.min, statistics.max)


def _meet(one: _Span | None, other: _Span) -> bool:
    return one is None or (one.low <= other.high and other.low <= one.high)
