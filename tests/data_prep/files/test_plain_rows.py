"""Rows that NumPy reads at once are those that the reader of lines reads, to the last bit."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from data_prep.failures import BadInput
from data_prep.files.clouds import read_cloud
from data_prep.files.plain_rows import MOST_LINE_LENGTH, plain_rows

# A comment behind the last row, which leaves the whole text to the reader of lines.
BY_LINES = b"\n# end\n"


@pytest.mark.parametrize(
    ("text", "separator"),
    [
        (b"1 2 .5\n-4e-1 5. +6E3\n", " "),
        (b"  1\t2  .5 \r\n-0.4 5 6000\r\n\r\n", " "),
        (b"1,2, .5\r-.4 ,5,6000", ","),
        (b"1\t2\t.5\n-4e-1\t5\t6000\n\n\n", "\t"),
        (b"1;2;.5\n-4e-1;5;6000", ";"),
        (b"1 | 2|.5\n-4e-1 | 5 | 6000", "|"),
    ],
)
def test_rows_of_plain_numbers(text: bytes, separator: str) -> None:
    rows = plain_rows(text, 3, separator)
    assert rows is not None
    assert rows.dtype == np.float64
    assert rows.tolist() == [[1, 2, 0.5], [-0.4, 5, 6000]]


def test_what_is_not_finite() -> None:
    rows = plain_rows(b"nan -NaN inf\n-Inf 1e999 -0", 3)
    assert rows is not None
    assert np.array_equal(rows, [[np.nan, np.nan, np.inf], [-np.inf, np.inf, 0]], equal_nan=True)
    assert np.signbit(rows).tolist() == [[False, True, False], [True, False, True]]


@pytest.mark.parametrize(
    ("text", "separator"),
    [
        (b"", " "),
        (b"\n", " "),
        (b"1 2 3\n4 5\n", " "),
        (b"1 2 3 4\n", " "),
        (b"1 2 3\n\n4 5 6\n", " "),
        (b"1 2 3\n  \n4 5 6\n", " "),
        (b"1 2 3 # leg\n", " "),
        (b'1,2,"3"\n', ","),
        (b"1,2,\n", ","),
        (b"1,2,3,\n", ","),
        (b"1;2,5;3\n", ";"),
        (b"1 2 NA\n", " "),
        (b"1 2 1_0\n", " "),
        (b"1 2 0x1A\n", " "),
        (b"1 2 1e\n", " "),
        (b"1\xa02 3\n", " "),
        (b"1 2\x0c3\n", " "),
        (b"1 2 3\n4 5 6" + b" " * MOST_LINE_LENGTH, " "),
    ],
)
def test_all_others_are_left_to_the_reader_of_lines(text: bytes, separator: str) -> None:
    assert plain_rows(text, 3, separator) is None


NUMBERS = st.one_of(
    st.floats(width=64).map(repr),
    st.floats(-1e6, 1e6).map("{:.3f}".format),
    st.floats(-1e3, 1e3).map("{:.17g}".format),
    st.floats(-1, 1).map("{:+.25e}".format),
    st.integers(-(10**20), 10**20).map(str),
)


@st.composite
def texts(draw: st.DrawFn) -> tuple[str, bytes]:
    """Return the name and the contents of a file in one of many layouts."""
    suffix = draw(st.sampled_from([".xyz", ".csv", ".pts"]))
    separator = draw(st.sampled_from([" ", "\t", "  ", ",", ", ", ";", " | "]))
    width = draw(st.integers(3, 7))
    rows = draw(st.lists(st.lists(NUMBERS, min_size=width, max_size=width), min_size=1))
    lines = [separator.join(row) for row in rows]
    if "," not in separator and draw(st.booleans()):
        lines = [line.replace(".", ",") for line in lines]
    names = ["x", "y", "z", "r", "g", "b", "i"][:width]
    above = draw(st.sampled_from([[], ["# of a leg"], [separator.join(names)], ["", "7"]]))
    end = draw(st.sampled_from(["\n", "\r\n", "\r"]))
    # One character of some text is another one, so that many of them are no tables.
    text = end.join([*above, *lines])
    if draw(st.booleans()):
        at = draw(st.integers(0, len(text) - 1))
        text = text[:at] + draw(st.sampled_from('x,. \n"#7;\t')) + text[at + 1 :]
    return f"a{suffix}", text.encode(draw(st.sampled_from(["utf-8", "utf-8-sig", "utf-16"])))


def read(path: Path, content: bytes, with_colors: bool) -> object:
    """Return all that is read of a text, or the refusal."""
    path.write_bytes(content)
    try:
        contents = read_cloud(path, with_colors)
    except BadInput as problem:
        return str(problem)
    colors = None if contents.colors is None else contents.colors.tolist()
    bits = contents.points.view(np.int64).tolist()
    return bits, list(contents.lines or ()), colors, contents.unused, contents.notes


@settings(derandomize=True, max_examples=300, deadline=None, database=None)
@given(text=texts(), with_colors=st.booleans())
def test_both_ways_of_reading_agree(text: tuple[str, bytes], with_colors: bool) -> None:
    name, content = text
    encoding = "utf-16" if content.startswith(b"\xff\xfe") else "utf-8"
    by_lines = content + BY_LINES.decode().encode(encoding).removeprefix(b"\xff\xfe")
    with TemporaryDirectory() as folder:
        path = Path(folder) / name
        assert read(path, content, with_colors) == read(path, by_lines, with_colors)
