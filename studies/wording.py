"""Names of conditions in words, for heads of tables and axes of figures."""

from __future__ import annotations

FULL = 2048  # points of a cloud


def condition_in_words(condition: str) -> str:
    """Return a condition as a reader without the list of conditions understands it.

    An id of another kind is returned as it is.
    """
    if condition.isdecimal():
        points = int(condition)
        return f"{points:,} points" if points == FULL else f"{points:,} of {FULL:,} points"
    kind, _, level = condition.rpartition("-")
    sentences = {
        "noise": "noise {share} of the radius",
        "outliers": "{share} outliers",
        "missing": "{share} missing",
        "density": "density {level} : 1",
    }
    if kind not in sentences:
        return condition
    share = f"{100 * float(level):g}\N{NO-BREAK SPACE}%"
    return sentences[kind].format(share=share, level=level)
