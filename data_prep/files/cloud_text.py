"""Clouds in columns of text: XYZ, TXT, CSV, PTS."""

from __future__ import annotations

import io
import re
from array import array
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from data_prep.files.cloud_contents import CloudContents, NotACloud, color_columns, colors_of
from data_prep.files.safe_read import MIB, shown

MOST_TEXT_BYTES = 64 * MIB  # 2 million points of the usual length; some 10 s
MOST_LINE_BYTES = 2**16
# Columns of colours where no line names them, by the number of columns.
XYZ_COLOURS = {6: (3, 4, 5)}
PTS_COLOURS = {6: (3, 4, 5), 7: (4, 5, 6)}  # of seven the fourth is the intensity


def read_text(
    data: bytes, with_colors: bool = False, unnamed: Mapping[int, tuple[int, ...]] = XYZ_COLOURS
) -> CloudContents:
    """Return the points of the lines, and how many columns are unused."""
    values, lines = array("d"), array("q")
    columns: tuple[int, ...] = (0, 1, 2)
    colours: tuple[int, ...] = ()
    width, begun = 3, False
    for number, line in text_lines(data.removeprefix(b"\xef\xbb\xbf")):
        text = line.partition(b"#")[0].strip()
        if not text:
            continue
        if not begun:
            begun, first = True, _fields(text)
            width = len(first)
            names = [field.strip(b" \"'/").lower().decode("utf-8", "replace") for field in first]
            named = {"x", "y", "z"} <= set(names)  # as `x,y,z` or `//X Y Z R G B`
            colours = color_columns(names) if named else unnamed.get(width, ())
            if named:
                columns = names.index("x"), names.index("y"), names.index("z")
            if with_colors:
                columns += colours
            if named:
                continue
        values.extend(numbers_of(_fields(text, max(columns) + 1), columns, f"line {number}"))
        lines.append(number)
    unused = (f"{width - 3} of its {width} columns",) if width > 3 else ()
    table = np.array(values, np.float64).reshape(-1, len(columns))
    colors = colors_of(table[:, 3:]) if len(columns) > 3 else None
    return CloudContents(table[:, :3], unused, lines, bool(colours), colors)


def _fields(text: bytes, most: int = -1) -> list[bytes]:
    """Return the first `most` fields of a line, and the rest of it as one."""
    return text.split(b",", most) if b"," in text else text.split(None, most)


def read_pts(data: bytes, with_colors: bool = False) -> CloudContents:
    """Return the points of all parts; the counts in the file are ignored."""
    lines = (b"#" if _COUNT.fullmatch(line.strip()) else line for line in data.split(b"\n"))
    return read_text(b"\n".join(lines), with_colors, PTS_COLOURS)


_COUNT = re.compile(rb"[0-9]{1,12}")


def text_lines(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield the lines with their numbers, from 1."""
    if len(data) > MOST_TEXT_BYTES:
        raise NotACloud(f"{len(data)} bytes of text, at most {MOST_TEXT_BYTES} are read; use NPY")
    file = io.BytesIO(data)
    number = 0
    while line := file.readline(MOST_LINE_BYTES + 1):
        number += 1
        if len(line) > MOST_LINE_BYTES:
            raise NotACloud(f"line {number} is longer than {MOST_LINE_BYTES} bytes; use short ones")
        yield number, line


def numbers_of(fields: Sequence[bytes], columns: Sequence[int], where: str) -> list[float]:
    """Return the numbers in these columns of a line. Raises NotACloud where one is missing."""
    if len(fields) <= max(columns):
        raise NotACloud(
            f"{where} has {len(fields)} columns, expected at least {max(columns) + 1}; give x, y "
            "and z" + (", red, green and blue" if len(columns) > 3 else "")
        )
    values = []
    for column in columns:
        try:
            if b"_" in fields[column]:  # Python's own, 1_000
                raise ValueError
            values.append(float(fields[column]))
        except ValueError:
            raise NotACloud(
                f"{where}: {shown(fields[column])} is not a number; start comment lines with #"
            ) from None
    return values
