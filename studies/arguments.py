"""Types of command-line arguments that several studies take."""

from __future__ import annotations


def names(text: str) -> tuple[str, ...]:
    """Return comma-separated names, each once, in their order."""
    return tuple(dict.fromkeys(text.split(",")))


def numbers(text: str) -> tuple[int, ...]:
    """Return comma-separated whole numbers.

    Raises ValueError for anything else.
    """
    return tuple(int(part) for part in text.split(","))


def positive(text: str) -> int:
    """Return a whole number from 1 on.

    Raises ValueError for anything else.
    """
    value = int(text)
    if value < 1:
        raise ValueError(text)
    return value
