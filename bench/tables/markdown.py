"""Grids and documents as Markdown, with text from files and users escaped.

Class and object ids are names of files, method ids may hold the path of a weights file, and reasons
quote both: any of them may carry markup, line breaks, escape sequences of terminals, or characters
that reverse the direction of text.
"""

from __future__ import annotations

import re
from collections.abc import Container, Iterable, Sequence

from bench.tables.grid import Block, Cell, Grid

# An underscore inside a word is no markup, and ids have many.
_MARKUP = re.compile(r"[\\`*\[\]<>|~$#&]|(?<![^\W_])_|_(?![^\W_])")


def visible(text: str) -> str:
    """Return the text as one line, with control, bidi and surrogate characters as escapes."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def cell(text: str) -> str:
    """Return Markdown that shows the text in a table's cell, a heading or a line of a list."""
    return _MARKUP.sub(lambda match: f"\\{match[0]}", visible(text))


def code(text: str) -> str:
    """Return the text as a Markdown code span; not for a table's cell."""
    shown = visible(text)
    longest = max((len(run) for run in re.findall("`+", shown)), default=0)
    # A fence longer than any backticks inside, which a space parts from it.
    fence = "`" * (longest + 1)
    return f"{fence} {shown} {fence}" if longest else f"{fence}{shown}{fence}"


def row(cells: Sequence[str]) -> str:
    """Return a row of a Markdown table; the cells are Markdown already."""
    return "| " + " | ".join(cells) + " |"


def document(blocks: Iterable[Block]) -> str:
    """Return paragraphs, headings and lists, which are Markdown already, and grids as one text.

    A blank line stands between blocks; empty ones are left out. What a mark means is said once,
    beneath the first grid that has it.
    """
    texts: list[str] = []
    said: set[str] = set()
    for block in blocks:
        texts.append(block if isinstance(block, str) else table(block, said))
        said |= set() if isinstance(block, str) else set(block.meanings)
    return "\n\n".join(text for text in texts if text) + "\n"


def table(grid: Grid, said: Container[str] = ()) -> str:
    """Return a grid as a Markdown table and a list of its notes; of a void grid the notes alone.

    said  the meanings of marks that are left out
    """
    if grid.void:
        return "\n".join(map(cell, grid.notes))
    notes = [note for note in grid.all_notes if note not in said]
    heads = [cell(head) for head in (grid.corner, *grid.columns)]
    lines = [cell(grid.remark), ""] if grid.remark else []
    lines += [row(heads), "|---" * len(heads) + "|"]
    lines += [row([cell(line.name), *map(_value, line.cells)]) for line in grid.lines]
    if notes:
        lines += ["", *(f"* {cell(note)}" for note in notes)]
    return "\n".join(lines)


def _value(shown: Cell) -> str:
    """Return the value with its interval in brackets, its counts of images, and what follows."""
    interval = " [{}, {}]".format(*map(cell, shown.interval)) if shown.interval else ""
    layout = shown.special.markdown if shown.special is not None else "{value}{interval}"
    text = layout.format(value=cell(shown.text), interval=interval)
    if shown.count is not None:
        text += " {}/{}".format(*shown.count)
        if shown.blank is not None and shown.value is not None:
            text += f" *b* {shown.blank}"
    return text + cell(shown.rest)
