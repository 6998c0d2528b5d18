"""Names of conditions in words, for heads of tables and axes of figures."""

from __future__ import annotations

from bench.catalogue.condition_names import condition_name


def condition_in_words(condition: str) -> str:
    """Return a condition in words that are short enough for the head of a column.

    An id of another kind is returned as it is.
    """
    name = condition_name(condition)
    shorter = {"missing": f"{name.short} missing", "density": f"density {name.short}"}
    return shorter.get(name.kind, name.words).replace(" %", "\N{NO-BREAK SPACE}%")
