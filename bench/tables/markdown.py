"""What comes from files and users, made harmless for Markdown and for terminals.

Class and object ids are names of files, method ids may hold the path of a weights file, and reasons
quote both: any of them may carry markup, line breaks, escape sequences of terminals, or characters
that reverse the direction of text.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

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
