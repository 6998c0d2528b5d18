"""Grids and documents as Markdown, with text from files and users escaped.

Class and object ids are names of files, method ids may hold the path of a weights file, and reasons
quote both: any of them may carry markup, line breaks, escape sequences of terminals, or characters
that reverse the direction of text.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bench.tables.table import Block, Cell, Grid, TableRow

# An underscore inside a word is no markup, and ids have many.
_MARKUP = re.compile(r"[\\`*\[\]<>|~$#&]|(?<![^\W_])_|_(?![^\W_])")


def visible(text: str) -> str:
    """One line of what can be seen: all else (control, bidi, surrogates) as Python writes it."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def cell(text: str) -> str:
    """The text as Markdown that shows it: in a table's cell, a heading, a line of a list."""
    return _MARKUP.sub(lambda found: f"\\{found[0]}", visible(text))


def code(text: str) -> str:
    """The text as a Markdown code span; not for a table's cell."""
    shown = visible(text)
    longest = max((len(run) for run in re.findall("`+", shown)), default=0)
    fence, space = "`" * (longest + 1), " " * bool(longest)
    return f"{fence}{space}{shown}{space}{fence}"


def row(cells: Sequence[str]) -> str:
    """A row of a Markdown table; the cells are Markdown already."""
    return "| " + " | ".join(cells) + " |"


def document(blocks: Iterable[Block]) -> str:
    """Paragraphs, headings and lists, which are Markdown already, and grids; a blank line between.

    An empty block is none.
    """
    texts = (block if isinstance(block, str) else table(block) for block in blocks)
    return "\n\n".join(text for text in texts if text) + "\n"


def table(grid: Grid) -> str:
    """A grid as a Markdown table, and its notes as a list; nothing measured: the notes alone."""
    if grid.void:
        return "\n".join(map(cell, grid.notes))
    heads = [grid.corner, *(head.name for head in grid.columns)]
    lines = [cell(grid.remark), ""] if grid.remark else []
    lines += [row(list(map(cell, heads))), "|---" * len(heads) + "|", *map(_line, grid.lines)]
    if grid.notes:
        lines += ["", *(f"* {cell(note)}" for note in grid.notes)]
    return "\n".join(lines)


def _line(line: TableRow) -> str:
    name = cell(line.name)
    if line.special is not None:
        name = line.special.markdown.format(value=name, interval="")
    return row([name, *map(_value, line.cells)])


def _value(of: Cell) -> str:
    """The value with its interval in brackets, how many images it is of, and what follows."""
    text = cell(of.text)
    interval = " [{}, {}]".format(*map(cell, of.interval)) if of.interval else ""
    shown = of.special.markdown if of.special is not None else "{value}{interval}"
    text = shown.format(value=text, interval=interval)
    if of.count is not None:
        text += " {}/{}".format(*of.count)
        if of.blank is not None and of.value is not None:
            text += f" *b* {of.blank}"
    return text + cell(of.rest)
