"""Text as wide as the terminal: the width, and lines wrapped at words. No package is imported."""

from __future__ import annotations

import shutil
import sys
import textwrap

NARROWEST = 8  # columns


def terminal_width(otherwise: int) -> int:
    """Return the columns of the terminal, or what COLUMNS says; `otherwise` without either."""
    return shutil.get_terminal_size((otherwise, 24)).columns


def line_width() -> int:
    """Return the columns that lines on stdout may have; 0, any number, where it is no terminal."""
    return terminal_width(80) if sys.stdout.isatty() else 0


def wrapped(text: str, width: int, first: str = "", further: str = "") -> list[str]:
    """Return the text as lines of at most `width` columns; 0: as one line.

    `first` stands before the first line, `further` before the others.
    """
    if not width:
        return [first + text]
    return textwrap.wrap(
        text,
        max(width, NARROWEST),
        initial_indent=first,
        subsequent_indent=further,
        break_on_hyphens=False,
    )
