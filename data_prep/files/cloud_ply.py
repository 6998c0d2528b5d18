"""Clouds and meshes in PLY, ascii or binary.

No library is used: trimesh reads a truncated text as if it were whole, and refuses binary files
with faces of different sizes; plyfile allocates memory for as many rows as the header claims, and
is under the GPL (`tests/upstream` shows the defects of both).
"""

from __future__ import annotations

import re
import struct
from array import array
from collections.abc import Sequence
from itertools import islice
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from data_prep.files.cloud_contents import (
    CHANNELS,
    COLOURS,
    CloudContents,
    NotACloud,
    PointColors,
    color_columns,
    colors_of,
)
from data_prep.files.cloud_text import numbers_of, text_lines
from data_prep.files.safe_read import shown

MOST_HEADER_BYTES = 2**16  # bytes in which the end of the header is looked for

# The first line tells whether lines end with \r, \n or both. After end_header only that is skipped,
# as a \n there may be the first byte of the numbers.
_PLY_HEADER = re.compile(
    rb"(?:\xef\xbb\xbf)?ply[ \t]*(?:\r?\n|(\r))((?:.*?[\r\n])?)end_header[ \t]*(?(1)\r|\r?\n)",
    re.DOTALL,
)
_BYTE_ORDERS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
# The types of PLY, by their names, as the letters by which `struct` and numpy know them.
_PLY_TYPES = {
    "char": "b", "uchar": "B", "short": "h", "ushort": "H", "int": "i", "uint": "I",
    "int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i", "uint32": "I",
    "int64": "q", "uint64": "Q", "float": "f", "double": "d", "float32": "f", "float64": "d",
}  # fmt: skip
_WHOLE = "bBhHiIqQ"  # the letters of the types of whole numbers
# Gaussian splats have colours as coefficients of the first spherical harmonic, which is constant,
# and the value of that harmonic, 1 / (2 sqrt(pi)).
_SPLAT_COLOURS = ("f_dc_0", "f_dc_1", "f_dc_2")
_HARMONIC = 0.28209479177387814
_SURFACES = ("face", "tristrips")  # the names of elements that hold polygons or strips of triangles
_CORNERS = ("vertex_indices", "vertex_index")  # the names of their lists of vertices


class _Property(NamedTuple):
    """A property: its name, its type, and for a list the type of its length, else ""."""

    name: str
    kind: str
    length: str = ""


class _Element(NamedTuple):
    name: str
    rows: int
    properties: list[_Property]

    def names(self, lists: bool = False) -> list[str]:
        """Return the names of all properties that are lists, or, by default, of those that are not.

        An empty text stands for each of the others.
        """
        return [p.name if bool(p.length) == lists else "" for p in self.properties]


class _Table(NamedTuple):
    """The rows of an element.

    columns  for each property an array with its numbers; for a list those are its lengths
    entries  for each property that is a list an array with the entries of all rows
    end      the position in the file of the byte behind the last row
    """

    element: _Element
    columns: Sequence[NDArray[Any]]
    entries: Sequence[NDArray[Any]]
    end: int

    def numbers(self, indices: Sequence[int]) -> NDArray[np.float64]:
        """Return the numbers of the properties at these indices, float64 [rows, properties]."""
        return np.stack([self.columns[i].astype(np.float64) for i in indices], axis=1)

    def colors(self, wanted: bool) -> tuple[bool, PointColors | None]:
        """Return whether the rows have colours, and the colours if they are wanted."""
        names = self.element.names()
        columns = color_columns(names)
        harmonics = not columns and set(_SPLAT_COLOURS) <= set(names)
        if harmonics:
            columns = tuple(names.index(name) for name in _SPLAT_COLOURS)
        if not columns or not wanted:
            return bool(columns), None
        values = self.numbers(columns)
        if harmonics:
            values = np.clip(0.5 + _HARMONIC * values, 0, 1)
        whole = all(self.element.properties[i].kind in _WHOLE for i in columns)
        return True, colors_of(values, whole)

    def triangles(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the triangles [F, 3] of polygons or strips, and the row [F] that each is of."""
        names = self.element.names(lists=True)
        lists = [name for name in names if name]
        corners_of = list(_CORNERS)
        if len(lists) == 1:  # a single list holds the corners, whatever its name is
            corners_of += lists
        index = next((names.index(name) for name in corners_of if name in names), None)
        if index is None:
            return np.empty((0, 3), np.int64), np.empty(0, np.int64)
        lengths, corners = (part[index].astype(np.int64) for part in (self.columns, self.entries))
        counts = np.maximum(lengths - 2, 0)
        rows = np.repeat(np.arange(len(counts)), counts)
        first = (np.cumsum(lengths) - lengths)[rows]
        step = np.arange(len(rows)) - (np.cumsum(counts) - counts)[rows]
        # All triangles of a polygon share its first corner. In a strip each begins a corner later.
        is_strip = self.element.name == "tristrips"
        begin = first + step if is_strip else first
        triangles = corners[np.stack([begin, first + step + 1, first + step + 2], axis=1)]
        if is_strip:
            kept = (triangles >= 0).all(axis=1)  # -1 ends a strip and begins another one
            return triangles[kept], rows[kept]
        return triangles, rows


def read_ply(data: bytes, with_colors: bool = False) -> CloudContents:
    """Return the vertices of a PLY, and its triangles if it has any.

    Raises NotACloud for a file that is no PLY of points, or is damaged.
    """
    header = _PLY_HEADER.match(data, 0, MOST_HEADER_BYTES)
    if header is None:
        raise NotACloud("no PLY header (ply ... end_header); use a PLY file")
    byte_order, elements = _ply_header(header[2])
    names = [element.name for element in elements]
    if names.count("vertex") != 1:
        raise NotACloud(
            f"{names.count('vertex')} elements vertex ({shown(', '.join(names))}), expected 1; use "
            "a PLY of points"
        )
    vertex = names.index("vertex")
    properties = elements[vertex].names()
    for axis in "xyz":
        if properties.count(axis) != 1:
            raise NotACloud(
                f"{properties.count(axis)} properties {axis} of the vertices "
                f"({shown(', '.join(properties))}), expected 1; use a PLY with x, y and z"
            )
    surface = next((i for i, e in enumerate(elements) if e.name in _SURFACES and e.rows), vertex)
    lines = None
    if byte_order == "=":
        tables, lines = _text_tables(data, len(header[0].splitlines()), elements)
        lines = lines[vertex]
    else:
        tables, end = [], header.end()
        for element in elements:
            tables.append(_table(element, data, end, byte_order))
            end = tables[-1].end
        _check_rest(len(data[end:].strip(b"\0 \t\r\n")), "bytes")
    points = tables[vertex].numbers([properties.index(axis) for axis in "xyz"])
    has_colors, colors = tables[vertex].colors(with_colors)
    unused = (COLOURS,) if set(CHANNELS[0]) & set(properties) or has_colors else ()
    if surface == vertex:
        return CloudContents(points, unused, lines, has_colors, colors)
    faces, rows = tables[surface].triangles()
    if faces.size and not 0 <= faces.min() <= faces.max() < len(points):
        raise NotACloud(
            f"faces have the vertices {faces.min()} to {faces.max()}, of {len(points)}; the file "
            "is damaged, fetch it again"
        )
    of_faces, face_colors = tables[surface].colors(with_colors)
    return CloudContents(
        points,
        unused=(*unused, f"its {elements[surface].rows} faces"),
        lines=lines,
        has_colors=has_colors or of_faces,
        colors=colors,
        faces=faces,
        face_colors=None if face_colors is None else face_colors[rows],
    )


def _ply_header(text: bytes) -> tuple[str, list[_Element]]:
    """Return the byte order and the elements in their order."""
    byte_order: str | None = None
    elements: list[_Element] = []
    for line in text.splitlines():
        match line.decode("utf-8", "replace").split():
            case [] | ["comment" | "obj_info", *_]:
                pass
            case ["format", kind, "1.0"] if kind in _BYTE_ORDERS and byte_order is None:
                byte_order = _BYTE_ORDERS[kind]
            case ["element", name, count] if re.fullmatch("[0-9]{1,12}", count):
                elements.append(_Element(name, int(count), []))
            case ["property", "list", length, kind, name] if (
                elements and _PLY_TYPES.get(length, "f") in _WHOLE and kind in _PLY_TYPES
            ):
                kinds = _PLY_TYPES[kind], _PLY_TYPES[length]
                elements[-1].properties.append(_Property(name.lower(), *kinds))
            case ["property", kind, name] if elements and kind in _PLY_TYPES:
                elements[-1].properties.append(_Property(name.lower(), _PLY_TYPES[kind]))
            case _:
                raise NotACloud(f"{shown(line)} in the PLY header; write the file again")
    if byte_order is None:
        raise NotACloud("no format in the PLY header; write the file again")
    return byte_order, elements


def _table(element: _Element, data: bytes, start: int, byte_order: str) -> _Table:
    """Return the rows of an element, which begin at the byte `start` of the data.

    Raises NotACloud where the data end before the rows do.
    """
    kinds = [(byte_order + p.kind, p.length and byte_order + p.length) for p in element.properties]
    if byte_order == "=":  # `_text_tables` has stored all numbers of a text as float64
        kinds = [("=d", p.length and "=d") for p in element.properties]
    end, row = start, np.dtype([(str(i), kind) for i, (kind, _) in enumerate(kinds)])
    columns, entries = [bytearray() for _ in kinds], [bytearray() for _ in kinds]
    lists = any(length for _, length in kinds)
    try:
        for _ in range(element.rows if lists else 0):
            for (kind, length), column, entry in zip(kinds, columns, entries, strict=True):
                at, end = end, end + struct.calcsize(length or kind)
                column += data[at:end]
                if length:
                    count = int(struct.unpack_from(length, data, at)[0])
                    at, end = end, end + struct.calcsize(kind) * range(count + 1)[-1]  # not below 0
                    entry += data[at:end]
    except (struct.error, ValueError, OverflowError, IndexError):
        end = len(data) + 1
    end += 0 if lists else element.rows * row.itemsize
    if end > len(data):
        raise NotACloud(
            f"{element.rows} rows of {shown(element.name)} in the header, and "
            f"{max(len(data) - start, 0)} bytes for them; the file is cut short, fetch it again"
        )
    if not lists:
        table = np.ndarray(element.rows if kinds else 0, row, data, start)
        return _Table(element, [table[str(i)] for i in range(len(kinds))], [], end)
    numbers = [np.frombuffer(columns[i], length or kind) for i, (kind, length) in enumerate(kinds)]
    of_lists = [np.frombuffer(entries[i], kind) for i, (kind, _) in enumerate(kinds)]
    return _Table(element, numbers, of_lists, end)


def _text_tables(
    data: bytes, header_lines: int, elements: Sequence[_Element]
) -> tuple[list[_Table], list[Sequence[int]]]:
    """Return the tables of an ascii PLY, and for each table the line of each row."""
    all_lines = text_lines(data)
    rows = ((n, f) for n, line in islice(all_lines, header_lines, None) if (f := line.split()))
    tables, lines = [], []
    for element in elements:
        values, counts, numbers = array("d"), array("q"), array("q")
        expected = len(element.properties)
        lists = [i for i, p in enumerate(element.properties) if p.length]
        for number, fields in islice(rows, element.rows if expected else 0):
            if len(fields) != expected and not lists:
                raise NotACloud(
                    f"line {number} has {len(fields)} columns, and the header has {expected}; "
                    "write the file again"
                )
            values.extend(numbers_of(fields, range(len(fields)), f"line {number}"))
            counts.append(len(fields))
            numbers.append(number)
        if len(numbers) < element.rows and expected:
            raise NotACloud(
                f"{element.rows} rows of {shown(element.name)} in the header, {len(numbers)} in "
                "the file; it is cut short, fetch it again"
            )
        tables.append(_table(element, values.tobytes(), 0, "="))
        told = expected + sum(tables[-1].columns[i] for i in lists)
        wrong = np.flatnonzero(np.array(counts) != told)
        if len(wrong):
            raise NotACloud(
                f"line {numbers[wrong[0]]} has other lists than it says; write the file again"
            )
        lines.append(numbers)
    _check_rest(sum(1 for _ in rows), "rows")
    return tables, lines


def _check_rest(count: int, what: str) -> None:
    if count:
        raise NotACloud(f"{count} more {what} than the header has; write the file again")
