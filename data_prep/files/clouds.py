"""Point clouds from and to files.

Formats: PLY (x, y and z of the vertices), NPY, text in columns (XYZ, TXT, CSV, PTS), and the
formats of scanners (`files.scans`). Except for scanners, memory is taken for the values in the
file, never for the sizes that it claims.
"""

from __future__ import annotations

import io
import math
import re
import warnings
from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data_prep.failures import BadInput, CannotWrite
from data_prep.files.atomic_write import write_whole
from data_prep.files.safe_read import MIB, read_file, shown
from data_prep.files.scans import SCAN_SUFFIXES, read_scan
from data_prep.scene import Points

MOST_BYTES = 256 * MIB  # 22 million points, which take 1.3 GiB of memory and some seconds
MOST_TEXT_BYTES = 64 * MIB  # 2 million points of the usual length; some 10 s
MOST_HEADER_BYTES = 2**16
MOST_LINE_BYTES = 2**16
COLOURS = "its colours"

CloudPoints = NDArray[np.float64]  # [N, 3]


@dataclass(frozen=True, eq=False)
class CloudContents:
    """The points of a file and a description of its other contents.

    Attributes
    ----------
    points : float64 array [N, 3]
        Coordinates in the order and units of the file.
    unused : tuple of str
        Other contents of the file, for people: "its colours".
    lines : sequence of int or None
        Line of each point in a text file, from 1.
    """

    points: CloudPoints
    unused: tuple[str, ...] = ()
    lines: Sequence[int] | None = None


def load_points(path: Path) -> CloudPoints:
    """Read the coordinates of the points in a file.

    PLY    ascii or binary, either byte order; other properties and elements are ignored
    NPY    an array of real numbers of shape [N, 3]
    text   the first three columns, or x, y and z of a first line that names all columns; separated
           by white space or commas; # begins a comment
    PTS    as text; lines of a single whole number, the counts of its parts, are ignored
    LAS, LAZ, E57, PCD  see `data_prep.files.scans`; large ones are thinned out

    Parameters
    ----------
    path : Path
        File whose suffix names its format.

    Returns
    -------
    float64 array [N, 3]
        Coordinates in the order and units of the file. N may be 0 and values may be NaN or
        infinite: the caller judges the cloud.

    Raises
    ------
    BadInput
        If the file cannot be read; names file, value and remedy.
    """
    return read_cloud(path).points


@np.errstate(over="ignore", invalid="ignore")  # odd NaNs, and values beyond float64
def read_cloud(path: Path) -> CloudContents:
    """Return the points of a file as `load_points` does, and a description of the rest."""
    check_cloud_name(path)
    if path.suffix.lower() in SCAN_SUFFIXES:
        points, has_colours = read_scan(path)
        return CloudContents(points, (COLOURS,) if has_colours else ())
    data = read_file(path, MOST_BYTES)
    try:
        return _READERS[path.suffix.lower()](data)
    except _NotACloud as problem:
        raise BadInput(f"{path}: {problem}") from problem.__cause__


def check_cloud_name(path: Path) -> None:
    """Raise BadInput for the name of a file in another format."""
    if path.suffix.lower() not in CLOUD_SUFFIXES:
        name = path.suffix or "a name without a suffix"
        raise BadInput(
            f"{path}: {name} is not supported as a point cloud; use one of "
            + ", ".join(CLOUD_SUFFIXES)
        )


def save_ply(points: Points, path: Path) -> None:
    """Write points as binary PLY, bit for bit, whole or not at all.

    Parameters
    ----------
    points : float32 array [N, 3]
        Coordinates.
    path : Path
        File to write; missing folders are made.

    Raises
    ------
    ValueError
        If the points have another dtype or shape.
    CannotWrite
        If the disk refuses.
    """
    if points.dtype.kind + str(points.itemsize) != "f4" or points.shape[1:] != (3,):
        raise ValueError(f"expected float32 [N, 3], got {points.dtype} {list(points.shape)}")
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
        "property float x\nproperty float y\nproperty float z\nend_header\n"
    )
    try:
        write_whole(path, header.encode() + points.astype("<f4").tobytes())
    except OSError as error:
        raise CannotWrite(
            f"{path}: cannot be written ({error.strerror}); make room, or give another path"
        ) from error


class _NotACloud(Exception):
    """A problem of a file with its remedy; `load_points` adds the name of the file."""


# --- PLY ------------------------------------------------------------------------------------------

_PLY_HEADER = re.compile(rb"ply\r?\n((?:.*?\n)?)end_header\r?\n", re.DOTALL)
_PLY_COLOURS = {"red", "r", "diffuse_red"}
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


def _read_ply(data: bytes) -> CloudContents:
    """Return the vertices; faces are only counted."""
    # Without a library: trimesh reads a truncated text as if it were whole and refuses binary files
    # with faces of different sizes; plyfile takes memory for as many rows as the header claims
    # (`tests/upstream` shows both), and is under the GPL.
    header = _PLY_HEADER.match(data, 0, MOST_HEADER_BYTES)
    if header is None:
        raise _NotACloud("no PLY header (ply ... end_header); use a PLY file")
    byte_order, elements = _ply_header(header[1])
    names = [element.name for element in elements]
    if "vertex" not in names:
        raise _NotACloud(f"no element vertex, but {shown(', '.join(names))}; use a PLY of points")
    *before, vertex = elements[: names.index("vertex") + 1]
    properties = [name for name, _ in vertex.properties]
    for axis in "xyz":
        if properties.count(axis) != 1:
            raise _NotACloud(
                f"{properties.count(axis)} properties {axis} of the vertices, expected 1; use a "
                "PLY with x, y and z"
            )
    if vertex.has_lists:
        raise _NotACloud("a list among the properties of the vertices; write it without")
    columns = [properties.index(axis) for axis in "xyz"]
    faces = sum(element.count for element in elements if element.name == "face")
    unused = (
        *((COLOURS,) if _PLY_COLOURS & set(properties) else ()),
        *((f"its {faces} faces",) if faces else ()),
    )
    if not byte_order:
        header_lines = data.count(b"\n", 0, header.end())
        points, lines = _ascii_vertices(data[header.end() :], before, vertex, columns)
        return CloudContents(points, unused, [header_lines + line for line in lines])
    points = _binary_vertices(data, header.end(), byte_order, before, vertex, columns)
    return CloudContents(points, unused)


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
                raise _NotACloud(f"{shown(line)} in the PLY header; write the file again")
    if byte_order is None:
        raise _NotACloud("no format in the PLY header; write the file again")
    return byte_order, elements


def _binary_vertices(
    data: bytes,
    start: int,
    byte_order: str,
    before: Sequence[_Element],
    vertex: _Element,
    columns: Sequence[int],
) -> CloudPoints:
    for element in before:
        if element.has_lists and element.count:
            raise _NotACloud(f"lists ({shown(element.name)}) before the vertices; write them after")
        start += element.count * _row(element, byte_order).itemsize
    row = _row(vertex, byte_order)
    have, need = len(data) - start, vertex.count * row.itemsize
    if have < need:
        raise _NotACloud(
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
) -> tuple[CloudPoints, Sequence[int]]:
    """Return the vertices, and the line of each after the header."""
    rows = ((n, f) for n, line in _lines(body) if (f := line.split(None, max(columns) + 1)))
    first = sum(element.count for element in before)
    values, lines = array("d"), array("q")
    for number, fields in islice(rows, first, first + vertex.count):
        values.extend(_numbers(fields, columns, f"line {number} after the header"))
        lines.append(number)
    if len(values) != 3 * vertex.count:
        raise _NotACloud(
            f"{vertex.count} vertices in the header, {len(values) // 3} in the file; it is cut "
            "short, fetch it again"
        )
    return np.array(values, np.float64).reshape(-1, 3), lines


# --- NPY ------------------------------------------------------------------------------------------


def _read_npy(data: bytes) -> CloudContents:
    """Return the rows of an array; nothing is unpickled, an array of objects is refused."""
    # Not by numpy.load, which takes memory for as many rows as the header claims; workers fill the
    # memory they take (`isolation.WORKER_ENVIRONMENT`), so that a claim would cost it all.
    file = io.BytesIO(data)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of headers written by Python 2
            version = np.lib.format.read_magic(file)
            read_header = {
                (1, 0): np.lib.format.read_array_header_1_0,
                (2, 0): np.lib.format.read_array_header_2_0,
            }[version]  # 3.0 is for tables with fancy names
            shape, by_columns, dtype = read_header(file)
    except Exception as error:  # numpy lets through any error of its parsers
        raise _NotACloud("not a readable NPY file; write it with numpy.save") from error
    if dtype.kind not in "fiu" or len(shape) != 2 or shape[1] != 3 or shape[0] < 0:
        raise _NotACloud(
            f"an array of {shown(str(dtype))} of shape {shown(str(shape))}; save real numbers of "
            "shape [N, 3]"
        )
    have, need = len(data) - file.tell(), math.prod(shape) * dtype.itemsize
    if have != need:
        raise _NotACloud(
            f"the header claims {shape[0]} points, {need} bytes, and {have} follow; the file is "
            "damaged, fetch it again"
        )
    values = np.frombuffer(data, dtype, 3 * shape[0], file.tell())
    rows = values.reshape(shape, order="F" if by_columns else "C")
    return CloudContents(np.array(rows, np.float64))


# --- text -----------------------------------------------------------------------------------------


def _read_text(data: bytes) -> CloudContents:
    """Return the points of the lines, and how many columns are unused."""
    values, lines = array("d"), array("q")
    columns, width, begun = (0, 1, 2), 3, False
    for number, line in _lines(data.removeprefix(b"\xef\xbb\xbf")):
        text = line.partition(b"#")[0].strip()
        if not text:
            continue
        if not begun:
            begun, first = True, _fields(text)
            width = len(first)
            names = [field.strip(b" \"'/").lower() for field in first]
            if {b"x", b"y", b"z"} <= set(names):  # as `x,y,z` or `//X Y Z R G B`
                columns = names.index(b"x"), names.index(b"y"), names.index(b"z")
                continue
        values.extend(_numbers(_fields(text, max(columns) + 1), columns, f"line {number}"))
        lines.append(number)
    unused = (f"{width - 3} of its {width} columns",) if width > 3 else ()
    return CloudContents(np.array(values, np.float64).reshape(-1, 3), unused, lines)


def _fields(text: bytes, most: int = -1) -> list[bytes]:
    """Return the first `most` fields of a line, and the rest of it as one."""
    return text.split(b",", most) if b"," in text else text.split(None, most)


def _read_pts(data: bytes) -> CloudContents:
    """Return the points of all parts; the counts in the file are ignored."""
    lines = (b"#" if _COUNT.fullmatch(line.strip()) else line for line in data.split(b"\n"))
    return _read_text(b"\n".join(lines))


_COUNT = re.compile(rb"[0-9]{1,12}")


def _lines(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield the lines with their numbers, from 1."""
    if len(data) > MOST_TEXT_BYTES:
        raise _NotACloud(f"{len(data)} bytes of text, at most {MOST_TEXT_BYTES} are read; use NPY")
    file = io.BytesIO(data)
    number = 0
    while line := file.readline(MOST_LINE_BYTES + 1):
        number += 1
        if len(line) > MOST_LINE_BYTES:
            raise _NotACloud(
                f"line {number} is longer than {MOST_LINE_BYTES} bytes; use short ones"
            )
        yield number, line


def _numbers(fields: Sequence[bytes], columns: Sequence[int], where: str) -> list[float]:
    if len(fields) <= max(columns):
        raise _NotACloud(
            f"{where} has {len(fields)} columns, expected at least {max(columns) + 1}; give x, y "
            "and z"
        )
    values = []
    for column in columns:
        try:
            if b"_" in fields[column]:  # Python's own, 1_000
                raise ValueError
            values.append(float(fields[column]))
        except ValueError:
            raise _NotACloud(
                f"{where}: {shown(fields[column])} is not a number; start comment lines with #"
            ) from None
    return values


_READERS = {
    ".ply": _read_ply,
    ".npy": _read_npy,
    ".xyz": _read_text,
    ".txt": _read_text,
    ".csv": _read_text,
    ".pts": _read_pts,
}
CLOUD_SUFFIXES = (*_READERS, *SCAN_SUFFIXES)
