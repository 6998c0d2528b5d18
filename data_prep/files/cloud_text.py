"""Clouds in columns of text: XYZ, TXT, CSV, ASC, PTS and their like."""

from __future__ import annotations

import csv
import io
import json
import re
import unicodedata
from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, islice, pairwise

import numpy as np
from numpy.typing import NDArray

from data_prep.files.cloud_contents import (
    CloudContents,
    NotACloud,
    axis_columns,
    color_columns,
    column_index,
    contents_of,
)
from data_prep.files.plain_rows import MOST_LINE_LENGTH, plain_rows
from data_prep.files.safe_read import MIB, shown
from data_prep.files.unnamed_columns import (
    MOST_UNNAMED,
    are_poses,
    are_times,
    colors_of_nine,
)

# The largest text: 2 million points in lines of the usual length. Where they have more than plain
# numbers, they take some 10 s to read.
MOST_TEXT_BYTES = 64 * MIB
HEAD = 64  # the number of first rows that are looked at to find out how rows are written
# The columns that hold colours where no line names the columns, by the number of columns. Where
# there are seven, the last one of an XYZ is the opacity, and the fourth of a PTS the intensity.
_XYZ_COLOURS = {6: (3, 4, 5), 7: (3, 4, 5)}
PTS_COLOURS = {6: (3, 4, 5), 7: (4, 5, 6)}

_COMMENTS = "#", "//", "%"  # the beginnings of lines that are comments
# A comment at the end of a row. In 1.#INF of Windows it is none, nor behind the mark of a field,
# as in x,y,z,#ff0000.
_NOTE = re.compile(r"(?<![\s;,|])\s+#.*")
_BLANK = " \t\n;,|"
MINUS = "\u2212"
_WHOLE = re.compile(r"[+-]?[0-9]+")
_NUMBER = re.compile(r"[+-]?(?:[0-9.][0-9.,' ]*(?:[ed][+-]?[0-9]+)?|inf(?:inity)?)", re.I)
_MISSING = re.compile(r"(?:[+-]?(?:nan(?:\(.*\))?|1\.#.+)|na|n/a|null|none)?", re.I)
_WITH_COMMA = re.compile(r"[+-]?[0-9]*,[0-9]+(?:e[+-]?[0-9]+)?", re.I)
_GROUPED = re.compile(r"[+-]?[1-9][0-9]{0,2},[0-9]{3}")  # thousands are separated, as in 657,700
# Two fields that may be one number, which was cut at the comma of 4,866.8, of 0,0666 or of -0,5.
_CUT = re.compile(r"[+-]?[0-9]{1,3} [0-9]{3}[.,][0-9]+")
_CUT_AT_POINT = re.compile(r"[+-]?[0-9]+ 0[0-9]+|-0 [0-9]+")
# A unit behind the name of a column, as in x (m). The x of P[x] is a name.
_COLUMN_UNIT = re.compile(r"\[(?![xyz]\])[^][]*\]|\([^()]*\)", re.I)
_INTRODUCTION = re.compile(r"\b\w+:\s")  # a word before names, as in Columns: x y z
_NUMBERS = "write numbers such as -1234.5 or 1e-3, without thousands separators"
_COMMAS = "commas are taken for decimal marks; if they are none, write numbers without them"
# The end of a note on columns that are taken for coordinates because they come first.
GUESSED = " (x, y and z are the first 3, as no first line names them)"

Rows = Iterable[tuple[int, str]]  # lines of text with their numbers, counted from 1


@dataclass(frozen=True)
class _Layout:
    """The way in which rows are written.

    separator      the character between fields; " " for any white space
    decimal_comma  whether numbers have a comma as their decimal mark
    width          the number of columns
    axes, colours  the columns of x, y and z, and of red, green and blue
    names          the names of all columns, or none
    unsure         whether the column taken for x may be a count of the points
    unused         texts on columns that are not used, such as "3 of its 6 columns"
    """

    separator: str = " "
    decimal_comma: bool = False
    width: int = 3
    axes: tuple[int, ...] = (0, 1, 2)
    colours: tuple[int, ...] = ()
    names: tuple[str, ...] = ()
    unsure: bool = False
    unused: tuple[str, ...] = ()


def read_text(
    data: bytes,
    with_colors: bool = False,
    unnamed: Mapping[int, tuple[int, ...]] = _XYZ_COLOURS,
    parts: bool = False,
    column: str = "",
) -> CloudContents:
    """Return the points of a text, and texts on columns that are not used.

    column   the name of a further column whose numbers are returned; "" for none
    unnamed  the columns of colours where no line names columns, by the number of columns
    parts    whether to pass over lines of a single whole number, which count the points of a part

    Raises NotACloud for a text that is no table of points.
    """
    encoding = json.detect_encoding(data[:4])  # UTF-8, 16 or 32
    names, separator, texts = _start_of(text_lines(data, encoding), parts)
    head = list(islice(texts, HEAD))
    layout, head = _layout_of(head, names, separator, unnamed)
    columns = layout.axes
    if with_colors:
        columns += layout.colours
    if column:
        columns += (column_index(layout.names, column),)
    table = _plain_table(data, encoding, head[0][0], columns, layout) if head else None
    if table is not None:
        lines = range(head[0][0], head[0][0] + len(table))
    else:
        rows = _split(chain(head, texts), layout.separator)
        table, lines = _table(rows, columns, layout, bool(names))
    if layout.unsure:
        _check_first_column(table, layout.width > 3)
    notes = (_COMMAS,) if layout.decimal_comma else ()
    return contents_of(
        table,
        bool(layout.colours),
        unused=layout.unused,
        lines=lines,
        notes=notes,
        columns=layout.names,
    )


def _plain_table(
    data: bytes, encoding: str, first_line: int, columns: Sequence[int], layout: _Layout
) -> NDArray[np.float64] | None:
    """Return what `_table` does of the rows from a line on; None unless all are plain numbers."""
    if max(columns) >= layout.width:
        return None
    text = data if encoding == "utf-8" else data.decode(encoding, "replace").encode()
    if first_line > 1:
        end_before = next(islice(re.finditer(rb"\r\n?|\n", text), first_line - 2, None))
        text = text[end_before.end() :]
    if layout.decimal_comma:
        if layout.separator == "," or b"." in text:
            return None
        text = text.replace(b",", b".")
    table = plain_rows(text, layout.width, layout.separator)
    return None if table is None else table[:, columns]


def _table(
    rows: Iterable[tuple[int, list[str]]], columns: Sequence[int], layout: _Layout, named: bool
) -> tuple[NDArray[np.float64], Sequence[int]]:
    """Return the numbers in some columns of rows, and the line of each row.

    Raises NotACloud, which names the line, for a row with another number of columns or without a
    number.
    """
    values, lines = array("d"), array("q")
    for number, fields in rows:
        if len(fields) != layout.width:
            # Another number of columns is accepted only where rows are separated by spaces: a row
            # may have words behind its numbers, and names of columns tell which ones count.
            is_row_of_numbers = not named and all(map(is_number, fields))
            if layout.separator != " " or is_row_of_numbers:
                raise _uneven(number, fields, layout.width)
        values.extend(numbers_of(fields, columns, f"line {number}", layout.decimal_comma))
        lines.append(number)
    return np.array(values, np.float64).reshape(-1, len(columns)), lines


def _layout_of(
    head: list[tuple[int, str]],
    names: list[str],
    separator: str,
    unnamed: Mapping[int, tuple[int, ...]],
) -> tuple[_Layout, list[tuple[int, str]]]:
    """Return how rows are written, by the first of them, and these first rows.

    A first row of numbers that name columns, as pandas writes them, is left out of them.
    """
    if not head:
        return _Layout(), head
    rows = [[field.strip() for field in fields] for _, fields in _split(head, separator)]
    guess: tuple[str, ...] = ()
    if not names and len(rows) > 1 and _are_numbered(rows[0], rows[1]):
        guess = (f"the numbers of line {head[0][0]}, taken for names of columns,",)
        names = [{"0": "x", "1": "y", "2": "z"}.get(field, "") for field in rows[0]]
        head, rows = head[1:], rows[1:]
    width, filled = len(rows[0]), sum(map(bool, rows[0]))
    labels = [row[0] for row in rows]
    counts = _counts(labels, 0) or _counts(labels, 1) or not any(map(is_number, labels))
    if names and width == len(names) + 1 and counts:
        names = ["", *names]  # as R and pandas write the names of rows
    elif names and separator != " " and any(rows[0][len(names) :]):
        raise _uneven(head[0][0], rows[0], len(names))
    axes = axis_columns(names) if names else (0, 1, 2)
    numbered = bool(guess or (names and names[axes[0]][-1:].isdigit()))
    unsure = axes[0] == 0 and (numbered or len(names) not in (filled, width))
    decimal_comma = _have_decimal_commas(rows)
    colours = color_columns(names) if names else unnamed.get(width, ())
    if not names or guess or _are_of_a_stem(names):
        numbers = _as_numbers(rows, decimal_comma)
        _check_kind(filled, numbers)
        if numbers is not None and width == 9 and unnamed:
            colours = colors_of_nine(numbers)
        if numbers is not None and (numbers[:, colours] < 0).any():
            colours = ()  # normals
    if unsure and filled > 3:
        _check_unnamed(rows, separator)
    if decimal_comma:
        _check_commas([row[axis] for row in rows for axis in axes if axis < len(row)])
    unused = guess
    if filled > 3:
        others = f"{filled - 3} of its {filled} columns"
        unused += (others + GUESSED if unsure else others,)
    layout = _Layout(
        separator=separator,
        decimal_comma=decimal_comma,
        width=width,
        axes=axes,
        colours=colours,
        names=tuple(names),
        unsure=unsure,
        unused=unused,
    )
    return layout, head


def _have_decimal_commas(rows: Sequence[Sequence[str]]) -> bool:
    """Return whether numbers have commas, and none has a point."""
    fields = [field for row in rows for field in row]
    points = any("." in field and _NUMBER.fullmatch(field) for field in fields)
    return any(map(_WITH_COMMA.fullmatch, fields)) and not points


def _are_of_a_stem(names: Sequence[str]) -> bool:
    """Return whether all names are a word with a number, such as V1, V2, V3."""
    stems = {re.sub("[0-9]+$", "", name) for name in names if name}
    return len(stems) == 1 and all(name[-1:].isdigit() for name in names if name)


def _check_kind(columns: int, numbers: NDArray[np.float64] | None) -> None:
    """Raise NotACloud where columns without names are those of a matrix or of poses."""
    if columns > MOST_UNNAMED:
        raise NotACloud(
            f"{columns} columns without names, as a matrix or an image has them; name x, y and z "
            "in a first line"
        )
    if numbers is not None and are_poses(numbers):
        raise NotACloud(
            "its rows are poses, a rotation with a position and perhaps a time; give a cloud, or "
            "name all columns in a first line, such as t,x,y,z"
        )


def _as_numbers(rows: Sequence[Sequence[str]], decimal_comma: bool) -> NDArray[np.float64] | None:
    """Return rows as numbers, float64 [rows, columns]; None where some are none."""
    width = len(rows[0])
    if any(len(row) != width for row in rows):
        return None
    try:
        return np.array([numbers_of(row, range(width), "", decimal_comma) for row in rows])
    except NotACloud:
        return None


def _start_of(
    lines: Iterator[tuple[int, str]], parts: bool
) -> tuple[list[str], str, Iterator[tuple[int, str]]]:
    """Return the names of the columns, the separator, and the rows."""
    names, header, comment, separator, count, degrees = [], [], "", "", 0, False
    for number, line in lines:
        text = _content(line)
        if not text.strip(_BLANK):
            if axis_columns(commented := _names(line.strip("#/% \t\n"))):
                names, comment = commented, line
            degrees |= _in_degrees(commented)
        elif match := re.fullmatch(r'"?sep=(.)"?', text, re.I):
            separator = match[1]
        elif text.isdigit() and (parts or not count):
            count += 1
        elif (comment or not names) and axis_columns(header := _names(text)):
            names, comment = header, ""
        else:
            separator = separator or _separator(text)
            ((_, fields),) = _split([(number, text)], separator)
            # Prose in a comment may have an x, a y and a z, too.
            if comment and not _names_columns(comment, names, len(fields)):
                names = []
            if not names and (degrees or _in_degrees(header)):
                raise NotACloud(
                    f"longitude and latitude are named up to line {number}; project them to "
                    "metres, and name columns x, y and z"
                )
            if not names:
                _check_row(number, text, fields)
            return names, separator, chain([(number, text)], _contents(lines, parts))
    return names, separator, iter(())


def _names(text: str) -> list[str]:
    """Return the names of columns without units, reduced to small letters and digits."""
    text = _COLUMN_UNIT.sub("", _INTRODUCTION.sub("", text, count=1)).strip(" ")
    separator = next((mark for mark in ";\t|," if mark in text), " ")
    fields = next(csv.reader([text], delimiter=separator, skipinitialspace=True), [])
    return [re.sub(r"[^a-z0-9]", "", field.lower()) for field in fields]


def _names_columns(comment: str, names: Sequence[str], columns: int) -> bool:
    """Return whether the words of a comment name the columns of a table with `columns` columns."""
    # A short list counts, as COLMAP names a group of several last columns once.
    is_short_list = "," in comment and len(names) < columns
    return is_short_list or len(names) == columns or names[:3] == ["x", "y", "z"]


def _in_degrees(names: Sequence[str]) -> bool:
    return {"lat", "lon"} <= {name[:3].replace("lng", "lon") for name in names}


def _are_numbered(row: Sequence[str], following: Sequence[str]) -> bool:
    """Return whether a row is 0, 1, 2 ..., as pandas names columns, and the next one is not."""
    names = [field for field in row if field]
    numbered = len(names) > 2 and _counts(names, 0)
    return numbered and not (row[0] and all(map(_WHOLE.fullmatch, following)))


def _counts(fields: Sequence[str], start: int) -> bool:
    return [*fields] == [str(start + i) for i in range(len(fields))]


def _check_row(number: int, text: str, fields: Sequence[str]) -> None:
    """Raise NotACloud for a first line without names that does not have three numbers."""
    if sum(is_number(field.strip()) for field in fields) < min(3, len(fields)):
        raise NotACloud(
            f"line {number}: {_quoted(text)} is no point, and no names of columns with x, y and z "
            "(each once, no degrees; separated by spaces, tabs, commas, semicolons or bars); "
            "remove or correct it"
        )


def _check_unnamed(rows: Sequence[Sequence[str]], separator: str) -> None:
    """Raise NotACloud where the first three of more columns are likely not x, y and z."""
    pairs = [list(pairwise(row[:16])) for row in rows]
    grouped = all(any(_CUT.fullmatch(f"{a} {b}") for a, b in row) for row in pairs)
    # Only a comma cuts a number: between blanks -0 and 0 are two.
    zeros = separator == "," and any(
        _CUT_AT_POINT.fullmatch(f"{a} {b}") for row in pairs for a, b in row
    )
    if grouped or zeros:
        raise NotACloud(f"its columns seem to be parts of numbers; {_NUMBERS}")
    first, *others = zip(*rows, strict=False)
    labels = not any(map(is_number, first))
    whole = [sum(_WHOLE.fullmatch(field) is not None for field in column) for column in others[:2]]
    counts = len(rows) > 2 and all(map(_WHOLE.fullmatch, first)) and 0 in whole
    if labels or counts:
        raise _first_column_counts(first[0])


def _check_commas(fields: Sequence[str]) -> None:
    """Raise NotACloud where some coordinates are grouped by commas, and the others are whole."""
    whole = [field for field in fields if _WHOLE.fullmatch(field)]
    grouped = [field for field in fields if _GROUPED.fullmatch(field)]
    if whole and grouped and len(whole) + len(grouped) == len(fields):
        raise NotACloud(f"{_quoted(grouped[0])} seems to have a thousands separator; {_NUMBERS}")


def _check_first_column(table: NDArray[np.float64], spare: bool) -> None:
    """Raise NotACloud where the first column counts the points, or goes on in equal steps.

    Equal steps alone may be those of a grid or a line. So two of three further signs are needed:
    three other columns are there for the coordinates (`spare`); there are many rows; the steps are
    of 1 from 0 or 1 on.
    """
    first = table[:, 0]
    if spare and are_times(first, table[:, 1:3]):
        raise NotACloud(
            f"its first column, '{first[0]:.10g}' and so on, only grows, as times do; name all "
            "columns in a first line, such as t,x,y,z"
        )
    steps = np.diff(first)
    if len(first) <= 2 or steps[0] == 0 or not np.allclose(steps, steps[0], 1e-3, 0):
        return
    is_long = len(first) > 15  # so many points in equal steps are hardly chance
    is_count = first[0] in (0, 1) and steps[0] == 1
    if sum((spare, is_long, is_count)) >= 2:
        raise _first_column_counts(f"{first[0]:g}")


def _first_column_counts(value: str) -> NotACloud:
    """Return the error on columns without names, the first of which counts or labels points."""
    return NotACloud(
        f"its first column, {_quoted(value)} and so on, seems to count or label the points; name "
        "all columns in a first line, such as id,x,y,z"
    )


def is_number(field: str) -> bool:
    """Return whether a field is a number, however it is written, or marks a missing number."""
    return bool(field) and bool(_NUMBER.fullmatch(field) or _MISSING.fullmatch(field))


def _separator(text: str) -> str:
    """Return the character that separates the fields of a row; " " for any white space."""
    for mark in ";\t|":
        if text.count(mark) > 1 and (mark != "\t" or all(text.split(mark)[:-1])):
            return mark
    words = text.split()
    apart = len(words) > 2 and all(map(_NUMBER.fullmatch, words)) and words[0][-1] != ","
    return "," if "," in text and not apart else " "


def _split(rows: Rows, separator: str) -> Iterator[tuple[int, list[str]]]:
    """Yield the number and the fields of each row; a quoted field ends on its line."""
    number = start = 0

    def texts() -> Iterator[str]:
        nonlocal number, start
        for number, text in rows:
            start = start or number
            yield text.replace("\t", " ").strip() if separator == " " else text

    reader = csv.reader(texts(), delimiter=separator, skipinitialspace=True)
    try:
        for count, fields in enumerate(reader, 1):
            if reader.line_num != count:
                raise csv.Error
            yield number, fields
            start = 0
    except csv.Error:
        raise NotACloud(f"a quote of line {start} is left open; close it on its line") from None


def _contents(lines: Rows, parts: bool) -> Iterator[tuple[int, str]]:
    """Yield the lines that are not empty; with `parts`, counts of points are left out."""
    for number, line in lines:
        text = _content(line)
        if text.strip(_BLANK) and not (parts and text.isdigit()):
            yield number, text


def _content(line: str) -> str:
    """Return a line without its end and without a comment."""
    text = line.strip(" \n")  # a tab may stand for an empty field
    if text.startswith(_COMMENTS):
        return ""
    return _NOTE.sub("", text) if "#" in text and '"' not in text else text


def text_lines(data: bytes, encoding: str = "utf-8") -> Iterator[tuple[int, str]]:
    """Yield the lines with their numbers, counted from 1; LF, CR LF and CR end a line.

    The minus of typesetters, U+2212, becomes the common one.

    Raises NotACloud for a text or a line that is too long.
    """
    if len(data) > MOST_TEXT_BYTES:
        raise NotACloud(f"{len(data)} bytes of text, at most {MOST_TEXT_BYTES} are read; use NPY")
    file = io.TextIOWrapper(io.BytesIO(data), encoding, errors="replace")
    for number, line in enumerate(file, 1):
        if len(line) > MOST_LINE_LENGTH:
            raise NotACloud(f"line {number} has {len(line)} characters, more than a row; break it")
        yield number, line.replace(MINUS, "-")


def numbers_of(
    fields: Sequence[str], columns: Sequence[int], where: str, decimal_comma: bool = False
) -> list[float]:
    """Return the numbers in these columns of a line; NaN for those that are marked as missing.

    Raises NotACloud where a column or a number is missing.
    """
    if len(fields) <= max(columns):
        raise NotACloud(
            f"{where} has {len(fields)} columns, expected at least {max(columns) + 1}; give x, y "
            "and z" + (", red, green and blue" if len(columns) == 6 else "")
        )
    values = []
    for column in columns:
        field = fields[column]
        try:
            if "_" in field:  # float() takes 1_000, which no program writes into files
                raise ValueError
            values.append(
                float(field.replace(".", "'").replace(",", ".") if decimal_comma else field)
            )
        except ValueError:
            if not _MISSING.fullmatch(field.strip()):
                raise _no_number(field, where) from None
            values.append(np.nan)
    return values


def _no_number(field: str, where: str) -> NotACloud:
    if _WITH_COMMA.fullmatch(field) and not _GROUPED.fullmatch(field):
        remedy = "it has a decimal comma, write points"
    else:
        remedy = _remedy([field])
    return NotACloud(f"{where}: {_quoted(field)} is not a number; {remedy}")


def _quoted(text: str) -> str:
    """Return a text for a message; of what is no text nothing is quoted."""
    controls = any(unicodedata.category(c) == "Cc" for c in text.replace("\t", " "))
    return "binary data" if controls or 4 * text.count("\ufffd") > len(text) else shown(text)


def _uneven(number: int, fields: Sequence[str], expected: int) -> NotACloud:
    remedy = _remedy(fields, ", and a text with separators in quotes")
    return NotACloud(f"line {number} has {len(fields)} columns, expected {expected}; {remedy}")


def _remedy(fields: Sequence[str], more: str = "") -> str:
    digits = re.search("[0-9]", "".join(fields))
    return f"{_NUMBERS}{more}" if digits else "correct or remove the line"
