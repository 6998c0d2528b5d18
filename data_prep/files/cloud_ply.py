"""Clouds and meshes in PLY, ascii or binary.

No library is used: trimesh reads a truncated text as if it were whole, and refuses binary files
with faces of different sizes; plyfile allocates memory for as many rows as the header claims, and
is under the GPL (`tests/upstream` shows the defects of both).
"""

from __future__ import annotations

import math
import re
import struct
from array import array
from collections.abc import Sequence
from dataclasses import replace
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
    column_index,
)
from data_prep.files.cloud_text import numbers_of, text_lines
from data_prep.files.polygons import (
    beyond_vertices,
    triangles_of_polygons,
    triangles_of_strips,
)
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
_KEYWORDS = ("ply", "format", "element", "property", "end_header")
_WHOLE = "bBhHiIqQ"  # the letters of the types of whole numbers
# Gaussian splats have colours as coefficients of the first spherical harmonic, which is constant,
# and the value of that harmonic, 1 / (2 sqrt(pi)).
_SPLAT_COLOURS = ("f_dc_0", "f_dc_1", "f_dc_2")
_HARMONIC = 0.28209479177387814
_SURFACES = ("face", "tristrips")  # the names of elements that hold polygons or strips of triangles
_CORNERS = ("vertex_indices", "vertex_index")  # the names of their lists of vertices
_PLACE_LISTS = ("texcoord", "texcoords")  # the names of their lists of places in a texture
_PLACES_OF_VERTICES = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"))
_TEXTURE = re.compile(rb"^comment\s+texturefile\s+(.+?)\s*$", re.IGNORECASE | re.MULTILINE)
# The opacity below which a Gaussian splat counts as one that cannot be seen: at most 13 of 255 over
# black. Trainings leave them around an object, far away from it.
_LEAST_OPACITY = 0.05


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

    def list_index(self, names: Sequence[str]) -> int | None:
        """Return the index of the first property that is a list of one of these names."""
        lists = self.element.names(lists=True)
        return next((lists.index(name) for name in names if name in lists), None)

    def surface(self, points: NDArray[np.float64]) -> _Surface:
        """Return the triangles of polygons, or of strips, whose vertices are at `points`.

        Raises NotACloud for a vertex that is not there.
        """
        lists = [name for name in self.element.names(lists=True) if name]
        only = lists if len(lists) == 1 else []  # a single list holds the corners in any case
        index = self.list_index([*_CORNERS, *only])
        if index is None:
            nothing = np.empty(0, np.int64)
            return _Surface(nothing, nothing.reshape(0, 3), nothing)
        lengths = self.columns[index].astype(np.int64)
        corners = self.entries[index].astype(np.int64)
        rows = np.repeat(np.arange(len(lengths)), lengths)  # of each corner
        is_strip = self.element.name == "tristrips"
        if is_strip:
            # -1 ends a strip and begins another one, as a new row does.
            begins = np.diff(rows, prepend=-1) > 0
            begins[1:] |= corners[:-1] == -1
            kept = corners != -1
            strips = (np.cumsum(begins) - 1)[kept]
            corners, rows = corners[kept], rows[kept]
            lengths = np.bincount(strips)
        if problem := beyond_vertices(corners, len(points)):
            raise NotACloud(problem)
        if is_strip:
            positions, _ = triangles_of_strips(lengths)
        else:
            positions, _ = triangles_of_polygons(points[corners], lengths)
        return _Surface(corners, positions, rows[positions[:, 0]])

    def texture_of(self, surface: _Surface) -> NDArray[np.int64] | None:
        """Return which texture each triangle has, by `texnumber`; None for a file with only one."""
        names = self.element.names()
        if "texnumber" not in names:
            return None
        return self.columns[names.index("texnumber")].astype(np.int64)[surface.rows]

    def places(self, surface: _Surface, vertices: _Table) -> NDArray[np.float64] | None:
        """Return the place [T, 3, 2] in the texture of the corners of triangles; None for none.

        Faces have a list of them, or else vertices have two numbers.
        """
        index = self.list_index(_PLACE_LISTS)
        if index is not None and self.entries[index].size == 2 * len(surface.corners):
            return self.entries[index].astype(np.float64).reshape(-1, 2)[surface.positions]
        names = vertices.element.names()
        for pair in _PLACES_OF_VERTICES:
            if set(pair) <= set(names):
                places = vertices.numbers([names.index(name) for name in pair])
                return places[surface.corners[surface.positions]]
        return None


class _Surface(NamedTuple):
    """Triangles.

    corners    int64 [C]: the vertices of all corners of the file's polygons or strips
    positions  int64 [T, 3]: the corners of each triangle
    rows       int64 [T]: the row of the file that each triangle is of
    """

    corners: NDArray[np.int64]
    positions: NDArray[np.int64]
    rows: NDArray[np.int64]


def read_ply(data: bytes, with_colors: bool = False, column: str = "") -> CloudContents:
    """Return the vertices of a PLY, and its triangles if it has any.

    column  the name of a property of the vertices whose numbers are returned; "" for none

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
    values = None
    if column:
        values = tables[vertex].numbers([column_index(properties, column)])[:, 0]
    columns = tuple(filter(None, properties))
    if surface == vertex:
        cloud = CloudContents(
            points, unused, lines, has_colors, colors, values=values, columns=columns
        )
        return _without_faint(tables[vertex], cloud)
    table = tables[surface]
    triangles = table.surface(points)
    of_faces, face_colors = table.colors(with_colors)
    others = [e for e in elements if e.name in _SURFACES and e.rows and e != elements[surface]]
    notes = tuple(f"its {other.rows} {other.name} are left out" for other in others)
    textures = tuple(name.decode("utf-8", "replace") for name in _TEXTURE.findall(header[2]))
    places = table.places(triangles, tables[vertex])
    if textures and places is None:
        notes += ("its texture is left out: not all corners have a place in it",)
    return CloudContents(
        points,
        unused=(*unused, f"its {elements[surface].rows} faces"),
        lines=lines,
        has_colors=has_colors or of_faces,
        colors=colors,
        faces=triangles.corners[triangles.positions],
        face_colors=None if face_colors is None else face_colors[triangles.rows],
        notes=notes,
        values=values,
        columns=columns,
        textures=textures,
        texture_places=places,
        texture_of_face=table.texture_of(triangles),
    )


def _without_faint(vertices: _Table, contents: CloudContents) -> CloudContents:
    """Return a cloud without the Gaussian splats that cannot be seen, and a note on them.

    Other clouds, and splats that are all faint, are returned as they are.
    """
    names = vertices.element.names()
    if not {*_SPLAT_COLOURS, "opacity"} <= set(names):
        return contents
    logits = vertices.numbers([names.index("opacity")])[:, 0]
    seen = logits >= math.log(_LEAST_OPACITY / (1 - _LEAST_OPACITY))
    if seen.all() or not seen.any():
        return contents
    faint = int((~seen).sum())
    return replace(
        contents,
        points=contents.points[seen],
        colors=None if contents.colors is None else contents.colors[seen],
        values=None if contents.values is None else contents.values[seen],
        lines=None if contents.lines is None else np.array(contents.lines)[seen],
        notes=(f"{faint} of {len(seen)} splats, of opacity below {_LEAST_OPACITY}, are left out",),
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
            case [word, *_] if word not in _KEYWORDS:
                pass  # a comment whose keyword is missing, as Blender 2.47 writes it
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
    whole = _uniform_rows(element.rows if kinds else 0, kinds, data, start)
    if whole is not None:
        columns, entries, end = whole
        return _Table(element, columns, entries, end)
    positions = _positions(element.rows, kinds, data, start)
    if positions is None:
        raise NotACloud(
            f"{element.rows} rows of {shown(element.name)} in the header, and "
            f"{max(len(data) - start, 0)} bytes for them; the file is cut short, fetch it again"
        )
    at, end = positions
    columns, entries = [], []
    for index, (kind, length) in enumerate(kinds):
        column = _numbers_at(data, length or kind, at[:, index])
        columns.append(column)
        entry = np.empty(0, kind)
        if length:
            counts = column.astype(np.int64)
            first = np.repeat(np.cumsum(counts) - counts, counts)
            step = np.arange(counts.sum()) - first
            begin = np.repeat(at[:, index] + np.dtype(length).itemsize, counts)
            entry = _numbers_at(data, kind, begin + step * np.dtype(kind).itemsize)
        entries.append(entry)
    return _Table(element, columns, entries, end)


_Kinds = Sequence[tuple[str, str]]  # for each property its type, and that of its length or ""


def _uniform_rows(
    rows: int, kinds: _Kinds, data: bytes, start: int
) -> tuple[list[NDArray[Any]], list[NDArray[Any]], int] | None:
    """Return the columns, the entries of lists and the end of rows that are all of one size.

    Return None where lists have several lengths, and where the data end before the rows do.
    """
    first = _positions(min(rows, 1), kinds, data, start)
    if first is None:
        return None
    at, _ = first
    fields: list[tuple[str, str, tuple[int, ...]]] = []
    lengths = [0] * len(kinds)
    for index, (kind, length) in enumerate(kinds):
        if length:
            if rows:
                lengths[index] = int(_numbers_at(data, length, at[0, index : index + 1])[0])
            fields.append((f"length {index}", length, ()))
        shape = (lengths[index],) if length else ()
        fields.append((str(index), kind, shape))
    row = np.dtype(fields)
    end = start + rows * row.itemsize
    if end > len(data):
        return None
    table = np.ndarray(rows if row.itemsize else 0, row, data, start)
    columns, entries = [], []
    for index, (_, length) in enumerate(kinds):
        column = table[f"length {index}" if length else str(index)]
        if length and (column != lengths[index]).any():
            return None
        columns.append(column)
        entries.append(table[str(index)].ravel() if length else table[str(index)][:0])
    return columns, entries, end


def _positions(
    rows: int, kinds: _Kinds, data: bytes, start: int
) -> tuple[NDArray[np.int64], int] | None:
    """Return the position [rows, properties] of each property in the data, and that of the end.

    Return None where the data end before the rows do.
    """
    steps = [
        (struct.Struct(length or kind), struct.calcsize(kind), bool(length))
        for kind, length in kinds
    ]
    at = array("q")
    here = start
    try:
        for _ in range(rows):
            for form, size, is_list in steps:
                at.append(here)
                if is_list:
                    count = int(form.unpack_from(data, here)[0])
                    if count < 0:
                        return None
                    here += form.size + size * count
                else:
                    here += size
            if here > len(data):
                return None
    except (struct.error, ValueError, OverflowError):  # a length beyond the end, or no number
        return None
    return np.array(at, np.int64).reshape(rows, len(kinds)), here


def _numbers_at(data: bytes, kind: str, positions: NDArray[np.int64]) -> NDArray[Any]:
    """Return the numbers of a type at positions in the data."""
    size = np.dtype(kind).itemsize
    if not len(positions):
        return np.empty(0, kind)
    # A number begins at each byte, so that each position can be looked up.
    everywhere = np.ndarray(len(data) - size + 1, kind, data, strides=(1,))
    return everywhere[positions]


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
