"""Clouds in PCD, the format of the Point Cloud Library (PCL).

What PCL reads is read: all versions, headers without VERSION, COUNT, POINTS or WIDTH, and a name
that two fields have. The format is described at
https://pointclouds.org/documentation/tutorials/pcd_file_format.html; what it leaves open is as in
`pcl::PCDReader`. A header costs no memory: what it claims is compared with the bytes that follow.
"""

from __future__ import annotations

import io
import re
import struct
from collections.abc import Mapping, Sequence
from itertools import islice
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from data_prep.files.cloud_contents import (
    NotACloud,
    ScanPoints,
    axis_columns,
    check_claim,
    color_columns,
    column_index,
)
from data_prep.files.cloud_text import numbers_of, text_lines
from data_prep.files.plain_rows import plain_rows
from data_prep.files.safe_read import MIB, shown

_MOST_HEADER_BYTES = 2**16  # bytes in which the line DATA is looked for
# The largest block that is unpacked: 128 million points of four floats.
_MOST_UNPACKED_BYTES = 2048 * MIB
# The most bytes that LZF makes of one: it repeats at most 264 bytes for three.
_MOST_EXPANSION = 88
_SIZES = {"F": ("4", "8"), "I": ("1", "2", "4", "8"), "U": ("1", "2", "4", "8")}
_ENCODINGS = ("ascii", "binary", "binary_compressed")
_PADDING = "_"  # the name of bytes that are no field
_PACKED = ("rgb", "rgba")  # the names of fields whose four bytes hold red, green and blue
_CHANNEL_SHIFTS = (16, 8, 0)  # where these stand in the number, in bits


class _Field(NamedTuple):
    """A field of each point: its name, its type as NumPy calls it, and how many numbers it has."""

    name: str
    kind: str
    numbers: int

    @property
    def bytes(self) -> int:
        """Return the bytes of the field in a point."""
        return self.numbers * int(self.kind[1:])


class _Header(NamedTuple):
    """A header.

    encoding  ascii, binary or binary_compressed
    points    the number of points that it claims
    end       the position of the first byte behind it
    """

    fields: list[_Field]
    encoding: str
    points: int
    end: int


def read_pcd(
    data: bytes, most_points: int, with_colors: bool = False, column: str = ""
) -> ScanPoints:
    """Return the points of a PCD, with their colours, or else the field `column`, if wanted.

    Of two fields with a name the first one is read. Points of three NaN, which an organised cloud
    has for no return, are left out; those with one or two NaN are, too, with a note.

    Raises NotACloud for a file that is no PCD of points, claims more than `most_points`, or is
    damaged, and ImportError where a compressed file needs the library `lzf`.
    """
    header = _header(data)
    check_claim(header.points, most_points)
    names = [field.name.lower() for field in header.fields]
    axes = tuple(names.index(axis) for axis in "xyz" if axis in names)
    if len(axes) != 3:
        axes = axis_columns(names)
    if not axes:
        raise NotACloud(
            f"no fields x, y and z among {shown(' '.join(names))}; name those of the coordinates so"
        )
    notes = tuple(
        f"{names.count(names[i])} fields {names[i]}: the first of them is read"
        for i in axes
        if names.count(names[i]) > 1
    )
    columns = _columns(data, header)
    points = np.stack([columns[i][:, 0].astype(np.float64) for i in axes], axis=1)
    missing = np.isnan(points)
    kept = ~missing.any(axis=1)  # as PCL takes them for valid
    partly = int((~kept & ~missing.all(axis=1)).sum())
    if partly:
        notes += (f"{partly} points without one of their coordinates are left out",)
    table = points[kept]
    packed = next((i for i, field in enumerate(header.fields) if _is_packed(field)), None)
    channels = color_columns(names)
    has_colors = packed is not None or bool(channels)
    whole = packed is not None or all(header.fields[i].kind[0] in "iu" for i in channels)
    if with_colors and has_colors:
        if packed is not None:
            colors = _unpacked(columns[packed][kept], header.fields[packed])
        else:
            colors = np.stack([columns[i][kept, 0].astype(np.float64) for i in channels], axis=1)
        table = np.concatenate([table, colors], axis=1)
    if column:
        values = columns[column_index(names, column)][kept, :1].astype(np.float64)
        table = np.concatenate([table, values], axis=1)
    return ScanPoints(table, has_colors, len(table), whole, notes, tuple(names))


def _header(data: bytes) -> _Header:
    """Return the header of a PCD."""
    values: dict[str, list[str]] = {}
    file = io.BytesIO(data[:_MOST_HEADER_BYTES])
    for line in file:
        words = line.decode("utf-8", "replace").split()
        if words and not words[0].startswith("#"):
            values[words[0].upper()] = words[1:]
        if "DATA" in values:
            break
    fields = values.get("FIELDS", values.get("COLUMNS"))
    encoding = "".join(values.get("DATA", ())).lower()
    if not fields or not encoding:
        raise NotACloud("no PCD header (FIELDS ... DATA); use a PCD file")
    if encoding not in _ENCODINGS:
        raise NotACloud(f"DATA {shown(encoding)}, and PCD has {', '.join(_ENCODINGS)}; correct it")
    sizes = _of_each_field(values, "SIZE", "4", fields)
    types = _of_each_field(values, "TYPE", "F", fields)
    counts = _of_each_field(values, "COUNT", "1", fields)
    read = []
    for name, size, kind, count in zip(fields, sizes, types, counts, strict=True):
        if size not in _SIZES.get(kind.upper(), ()):
            raise NotACloud(
                f"TYPE {shown(kind)} and SIZE {shown(size)} of the field {shown(name)}: there are "
                "F of 4 and 8 bytes, I and U of 1, 2, 4 and 8; correct them"
            )
        number = _whole_number("COUNT", count)
        if number == 0:
            raise NotACloud(f"COUNT 0 of the field {shown(name)}; remove the field, or correct it")
        read.append(_Field(name, kind.lower() + size, number))
    return _Header(read, encoding, _count(values), file.tell())


def _of_each_field(
    values: Mapping[str, list[str]], keyword: str, default: str, fields: Sequence[str]
) -> list[str]:
    """Return what a line of the header has for each field; without the line it is a default."""
    given = values.get(keyword, [default] * len(fields))
    if len(given) != len(fields):
        raise NotACloud(
            f"FIELDS has {len(fields)} names, {keyword} {len(given)} values; correct the header"
        )
    return given


def _count(values: Mapping[str, list[str]]) -> int:
    """Return the number of points: POINTS, which WIDTH x HEIGHT has to be, too."""
    told = {
        keyword: _whole_number(keyword, " ".join(values[keyword]))
        for keyword in ("POINTS", "WIDTH", "HEIGHT")
        if keyword in values
    }
    grid = told.get("WIDTH", 0) * max(told.get("HEIGHT", 1), 1)
    points = told.get("POINTS", grid)
    if "POINTS" not in told and "WIDTH" not in told:
        raise NotACloud("neither POINTS nor WIDTH in the header; add the number of points")
    # As in PCL, a width of 0 says nothing.
    if grid not in (0, points):
        raise NotACloud(
            f"WIDTH {told['WIDTH']} x HEIGHT {told.get('HEIGHT', 1)} are {grid} points, and POINTS "
            f"says {points}; correct the header"
        )
    return points


def _whole_number(keyword: str, text: str) -> int:
    """Return the whole number of a line of the header."""
    if not re.fullmatch("[0-9]{1,18}", text):
        raise NotACloud(f"{keyword} {shown(text)} is no whole number of at least 0; correct it")
    return int(text)


def _columns(data: bytes, header: _Header) -> list[NDArray[np.generic]]:
    """Return the numbers of each field, [points, count]."""
    if header.encoding == "ascii":
        table = _text_table(data, header)
        ends = np.cumsum([field.numbers for field in header.fields])
        return np.split(table, ends[:-1], axis=1)
    if header.points == 0:
        return [np.empty((0, 1)) for _ in header.fields]
    return _rows(data, header) if header.encoding == "binary" else _columns_of_block(data, header)


def _text_table(data: bytes, header: _Header) -> NDArray[np.float64]:
    """Return the numbers of an ascii PCD, float64 [points, numbers]."""
    width = sum(field.numbers for field in header.fields)
    table = plain_rows(data[header.end :], width)
    if table is None:
        rows = []
        for number, line in islice(text_lines(data), data.count(b"\n", 0, header.end), None):
            fields, where = line.split(), f"line {number}"
            if fields and len(fields) != width:
                raise NotACloud(
                    f"{where} has {len(fields)} columns, and the header has {width}; write the "
                    "file again"
                )
            if fields:
                rows.append(numbers_of(fields, range(width), where))
        table = np.array(rows, np.float64).reshape(-1, width)
    _check_size(header, len(table), header.points, "rows")
    if len(table) > header.points:
        raise NotACloud(
            f"{len(table)} rows behind the header, which has {header.points} points; correct it"
        )
    return table


def _rows(data: bytes, header: _Header) -> list[NDArray[np.generic]]:
    """Return the columns of a binary PCD. Bytes behind the last point are padding, as in PCL."""
    step = sum(field.bytes for field in header.fields)
    _check_size(header, len(data) - header.end, header.points * step, "bytes")
    formats = [(str(i), f"<{f.kind}", (f.numbers,)) for i, f in enumerate(header.fields)]
    table = np.frombuffer(data, np.dtype(formats), header.points, header.end)
    return [table[str(i)] for i in range(len(formats))]


def _columns_of_block(data: bytes, header: _Header) -> list[NDArray[np.generic]]:
    """Return the columns of a compressed PCD: one field behind the other, packed as a block."""
    _check_size(header, len(data) - header.end, 8, "bytes")
    packed_bytes, block_bytes = struct.unpack_from("<II", data, header.end)
    step = sum(field.bytes for field in header.fields)
    padding = [i for i, field in enumerate(header.fields) if field.name == _PADDING]
    if header.points * step != block_bytes:
        # PCL leaves out the padding where it packs, but not always in the header.
        step -= sum(header.fields[i].bytes for i in padding)
    else:
        padding = []
    needed = header.points * step
    if needed != block_bytes or needed > _MOST_UNPACKED_BYTES:
        raise NotACloud(
            f"a block of {block_bytes} bytes, and {header.points} points need {needed}, at most "
            f"{_MOST_UNPACKED_BYTES}; correct the header, or write the file again"
        )
    packed = data[header.end + 8 : header.end + 8 + packed_bytes]
    _check_size(header, len(packed), packed_bytes, "packed bytes")
    block = packed if packed_bytes == block_bytes else _decompressed(packed, block_bytes)
    columns, start = [], 0
    for i, field in enumerate(header.fields):
        count = 0 if i in padding else field.numbers
        numbers = np.frombuffer(block, f"<{field.kind}", header.points * count, start)
        columns.append(numbers.reshape(header.points, count))
        start += numbers.nbytes
    return columns


def _decompressed(packed: bytes, size: int) -> bytes:
    """Return a block of `size` bytes that LZF has packed."""
    import lzf

    try:
        # The library allocates as many bytes as it is told.
        block = lzf.decompress(packed, size) if size <= _MOST_EXPANSION * len(packed) else None
    except ValueError:
        block = None
    if block is None or len(block) != size:
        raise NotACloud(
            f"the {len(packed)} packed bytes do not become the {size} that they stand for; the "
            "file is damaged, fetch or write it again"
        )
    return block


def _check_size(header: _Header, have: int, need: int, what: str) -> None:
    """Raise NotACloud where less follows the header than it claims."""
    if have < need:
        raise NotACloud(
            f"{header.points} points in the header need {need} {what}, and {have} follow; the file "
            "is cut short, fetch or write it again"
        )


def _is_packed(field: _Field) -> bool:
    """Return whether a field has red, green and blue, in one number or in a byte each."""
    is_number = field.numbers == 1 and field.kind[1:] == "4"
    is_bytes = field.numbers in (3, 4) and field.kind == "u1"
    return field.name.lower() in _PACKED and (is_number or is_bytes)


def _unpacked(values: NDArray[np.generic], field: _Field) -> NDArray[np.float64]:
    """Return red, green and blue, float64 [points, 3], of a field that packs them.

    They are NaN where a text has a number that packs nothing.
    """
    if field.numbers > 1:
        return values[:, :3].astype(np.float64)
    numbers, valid = values[:, 0], np.ones(len(values), bool)
    if numbers.dtype.itemsize == 4:
        bits = np.ascontiguousarray(numbers).view(np.uint32)
    else:  # of a text, where all numbers are float64
        is_whole = (numbers == np.floor(numbers)) & (np.abs(numbers) < 2**32)
        # Bits of a float are those of a number far below 1, unless they have an opacity. So whole
        # numbers in a field of floats are the packed number itself, as in the sample of PCL's docs.
        of_float = field.kind[0] == "f" and not (is_whole.all() and numbers.max(initial=0) >= 1)
        valid = ~np.isnan(numbers) if of_float else is_whole
        filled = np.where(valid, numbers, 0)
        if of_float:
            bits = filled.astype(np.float32).view(np.uint32)
        else:
            bits = (filled.astype(np.int64) & 0xFFFFFFFF).astype(np.uint32)
    channels = (bits[:, None] >> np.array(_CHANNEL_SHIFTS, np.uint32)) & 255
    return np.where(valid[:, None], channels, np.nan)
