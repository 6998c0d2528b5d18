from __future__ import annotations

import csv
import html
import io
import re

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from markdown_it import MarkdownIt

from bench.tables.markdown import cell, code, row, visible
from bench.tables.table import csv_text

ODD = [
    "a|b", "`x`", "``", "a``b`", "*b*", "_b_", "__b__", "snake_case", "[a](b)", "![a](b)", "<b>",
    "<script>alert(1)</script>", "<!-- x", "&lt;", "&#124;", "~~a~~", "$x$", "\\", "\\|", "a\\",
    "new\nline", "\r", "\t", "\x1b[31mred\x1b[0m", "\u202egnp.exe", "\u2066", "\u200b", "\x00",
    "\udcff", "\u2028", "\xa0", "# a", "a #", "- a", "1. a", "> a", "a  ", "    a", "http://a_b_c",
    "===", "---", "| --- |", "[a]: b", "é", "椅子", "😀",
]  # fmt: skip
PARSER = MarkdownIt("commonmark").enable(["table", "strikethrough"])  # an independent reader


@pytest.mark.parametrize(
    "name",
    [
        "chair", "pc2pix@acgan", "surface-apss", "noise-0.05", "2048", "test-0007", "table_x.ply",
        "2 x ball-pivoting: no faces; 1 x timeout: no result within 120 s", "a (b), c's: 75 %",
        "skipped: weights; give --inception-weights download, or the path of https://x.org/a-b.pth",
    ],
)  # fmt: skip
def test_ordinary_names_stay_as_they_are(name: str) -> None:
    assert cell(name) == visible(name) == name
    assert code(name) == f"`{name}`"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a\nb", r"a\nb"),
        ("\x1b[2J", r"\x1b[2J"),
        ("\u202e\u200b", r"\u202e\u200b"),
        ("\udcff\U000e0001", r"\udcff\U000e0001"),
        ("a b\u3000é椅😀", r"a b\u3000é椅😀"),
        ("", ""),
    ],
)
def test_what_cannot_be_seen_is_written_out(text: str, expected: str) -> None:
    assert visible(text) == expected


def text_of(rendered: str) -> str:
    """What a reader sees; fails where the text has become markup."""
    assert "<" not in rendered, rendered
    return html.unescape(rendered)


def odd_texts(test):
    for text in ODD:
        test = example(text)(test)
    anything = st.text(st.characters(), max_size=20) | st.text(
        "|`*_[]()<>\\~$#&!\n -a", max_size=12
    )
    return settings(derandomize=True, max_examples=200, deadline=None)(given(anything)(test))


@odd_texts
def test_a_cell_shows_its_text_and_nothing_else(text: str) -> None:
    table = f"{row(['method', cell(text), 'n'])}\n|---|---|---|\n{row([cell(text), '1', '2'])}\n"
    cells = re.findall("<t[hd]>(.*?)</t[hd]>", PARSER.render(table), re.DOTALL)
    assert len(cells) == 6
    # Spaces around a cell are the table's.
    assert text_of(cells[1]) == text_of(cells[3]) == visible(text).strip()


@odd_texts
def test_a_heading_and_a_line_of_a_list_show_their_text(text: str) -> None:
    rendered = PARSER.render(f"## ssim, {cell(text)}\n\n* x at y: {cell(text)}\n")
    found = re.fullmatch(
        "<h2>ssim,(.*)</h2>\n<ul>\n<li>x at y:(.*)</li>\n</ul>\n", rendered, re.DOTALL
    )
    assert found is not None, rendered
    assert text_of(found[1]).strip() == text_of(found[2]).strip() == visible(text).strip()


@odd_texts
def test_code_shows_its_text(text: str) -> None:
    rendered = PARSER.render(f"{code(text)}: x")
    if not text.strip():
        return  # there is no empty span
    found = re.fullmatch("<p><code>(.*)</code>: x</p>\n", rendered, re.DOTALL)
    assert found is not None, rendered
    assert text_of(found[1]).strip() == visible(text).strip()


@odd_texts
def test_csv_is_read_as_it_was_written(text: str) -> None:
    rows = [[text, "x", text], ["", text, "end"]]
    written = csv_text(["a", text, "c"], rows)
    assert list(csv.reader(io.StringIO(written, newline=""))) == [["a", text, "c"], *rows]


def test_csv_to_the_letter() -> None:
    assert csv_text("ab", [[1, 0.5], ["x,y", ""], ['"', "\r"]]) == 'a,b\n1,0.5\n"x,y",\n"""","\r"\n'
    assert csv_text(["a"], []) == "a\n"
