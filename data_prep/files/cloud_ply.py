"""Clouds in PLY, ascii or binary.

Without a library: trimesh reads a truncated text as if it were whole and refuses binary files with
faces of different sizes; plyfile takes memory for as many rows as the header claims
(`tests/upstream` shows both), and is under the GPL.
"""

from __future__ import annotations

import re
from array import array
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from data_prep.files.cloud_contents import (
    CHANNELS,
    COLOURS,
    CloudContents,
    NotACloud,
    color_columns,
    colors_of,
)
from data_prep.files.cloud_text import numbers_of, text_lines
from data_prep.files.safe_read import shown

MOST_HEADER_BYTES = 2**16

_PLY_HEADER = re.compile(rb"ply\r?\n((?:.*?\n)?)end_header\r?\n", re.DOTALL)
_BYTE_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_PLY_TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4",
    "float": "f4", "double": "f8",
    "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
    "float32": "f4", "float64": "f8",
}  # fmt: skip


@dataclass
class _Element:
    """An element of a PLY. Properties are names and types ("f4"); the type of a list is ""."""

    name: str
    count: int
    properties: list[tuple[str, str]]

    @property
    def has_lists(self) -> bool:
        return any(not code for _, code in self.properties)


def read_ply(data: bytes, with_colors: bool = False) -> CloudContents:
    """Return the vertices; faces are only counted."""
    header = _PLY_HEADER.match(data, 0, MOST_HEADER_BYTES)
    if header is None:
        raise NotACloud("no PLY header (ply ... end_header); use a PLY file")
    byte_order, elements = _ply_header(header[1])
    names = [element.name for element in elements]
    if "vertex" not in names:
        raise NotACloud(f"no element vertex, but {shown(', '.join(names))}; use a PLY of points")
    *before, vertex = elements[: names.index("vertex") + 1]
    properties = [name for name, _ in vertex.properties]
    for axis in "xyz":
        if properties.count(axis) != 1:
            raise NotACloud(
                f"{properties.count(axis)} properties {axis} of the vertices, expected 1; use a "
                "PLY with x, y and z"
            )
    if vertex.has_lists:
        raise NotACloud("a list among the properties of the vertices; write it without")
    columns = [properties.index(axis) for axis in "xyz"]
    colours = color_columns(properties)
    if with_colors:
        columns += colours
    faces = sum(element.count for element in elements if element.name == "face")
    any_red = set(CHANNELS[0]) & set(properties)
    unused = (*((COLOURS,) if any_red else ()), *((f"its {faces} faces",) if faces else ()))
    lines = None
    if byte_order:
        table = _binary_vertices(data, header.end(), byte_order, before, vertex, columns)
    else:
        table, numbers = _ascii_vertices(data[header.end() :], before, vertex, columns)
        header_lines = data.count(b"\n", 0, header.end())
        lines = [header_lines + number for number in numbers]
    colors = None
    if len(columns) > 3:
        whole = all(vertex.properties[i][1][0] in "iu" for i in colours)
        colors = colors_of(table[:, 3:], whole)
    return CloudContents(table[:, :3], unused, lines, bool(colours), colors)


def _ply_header(text: bytes) -> tuple[str, list[_Element]]:
    """Return the byte order ("" for text) and the elements in their order."""
    byte_order: str | None = None
    elements: list[_Element] = []
    for line in text.split(b"\n"):
        match line.decode("utf-8", "replace").split():
            case [] | ["comment" | "obj_info", *_]:
                pass
            case ["format", kind, "1.0"] if kind in _BYTE_ORDERS and byte_order is None:
                byte_order = _BYTE_ORDERS[kind]
            case ["element", name, count] if re.fullmatch("[0-9]{1,12}", count):
                elements.append(_Element(name, int(count), []))
            case ["property", "list", length, kind, name] if (
                elements and length in _PLY_TYPES and kind in _PLY_TYPES
            ):
                elements[-1].properties.append((name, ""))
            case ["property", kind, name] if elements and kind in _PLY_TYPES:
                elements[-1].properties.append((name, _PLY_TYPES[kind]))
            case _:
                raise NotACloud(f"{shown(line)} in the PLY header; write the file again")
    if byte_order is None:
        raise NotACloud("no format in the PLY header; write the file again")
    return byte_order, elements


def _binary_vertices(
    data: bytes,
    start: int,
    byte_order: str,
    before: Sequence[_Element],
    vertex: _Element,
    columns: Sequence[int],
) -> NDArray[np.float64]:
    """Return these columns of the vertices, [N, columns]."""
    for element in before:
        if element.has_lists and element.count:
            raise NotACloud(f"lists ({shown(element.name)}) before the vertices; write them after")
        start += element.count * _row(element, byte_order).itemsize
    row = _row(vertex, byte_order)
    have, need = len(data) - start, vertex.count * row.itemsize
    if have < need:
        raise NotACloud(
            f"{vertex.count} vertices of {row.itemsize} bytes in the header, and {max(have, 0)} "
            "bytes for them; the file is cut short, fetch it again"
        )
    rows = np.frombuffer(data, row, vertex.count, start)
    return np.stack([rows[str(i)].astype(np.float64) for i in columns], axis=1)


def _row(element: _Element, byte_order: str) -> np.dtype:
    """Return the type of a row of an element without lists, with numbered fields."""
    # Numbers, because a name may occur twice.
    return np.dtype([(str(i), byte_order + c) for i, (_, c) in enumerate(element.properties)])


def _ascii_vertices(
    body: bytes, before: Sequence[_Element], vertex: _Element, columns: Sequence[int]
) -> tuple[NDArray[np.float64], Sequence[int]]:
    """Return these columns of the vertices, [N, columns], and the line of each after the header."""
    rows = ((n, f) for n, line in text_lines(body) if (f := line.split(None, max(columns) + 1)))
    first = sum(element.count for element in before)
    values, lines = array("d"), array("q")
    for number, fields in islice(rows, first, first + vertex.count):
        values.extend(numbers_of(fields, columns, f"line {number} after the header"))
        lines.append(number)
    if len(lines) != vertex.count:
        raise NotACloud(
            f"{vertex.count} vertices in the header, {len(lines)} in the file; it is cut short, "
            "fetch it again"
        )
    return np.array(values, np.float64).reshape(-1, len(columns)), lines
