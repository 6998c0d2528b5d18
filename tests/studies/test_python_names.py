"""The signatures of docs/api.md are those of the code."""

from __future__ import annotations

from studies.python_names import PAGE, filled


def test_the_page_is_what_the_code_says():
    """Run python -m studies.python_names where this fails."""
    text = PAGE.read_text(encoding="utf-8")
    assert filled(text) == text
