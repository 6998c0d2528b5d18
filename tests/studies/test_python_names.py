"""The signatures of docs/api.md are those of the code."""

from __future__ import annotations

from studies.python_names import PAGE, call, class_lines, filled


def a_function(first: int, *, second: str | None = None) -> dict[str, float]:
    """Return nothing."""
    raise NotImplementedError


class Shape:
    """A shape."""

    def __init__(self, sides: int) -> None:
        self.sides = sides

    def area(self, scale: float = 1.0) -> float:
        """Return its area."""
        raise NotImplementedError

    def _hidden(self) -> None: ...


def test_a_signature_has_its_types_without_quotation_marks():
    expected = "a_function(first: int, *, second: str | None = None) -> dict[str, float]"
    assert call("a_function", a_function) == expected


def test_a_long_signature_breaks_between_parameters():
    lines = call("a" * 60, a_function).splitlines()
    assert lines == [
        "a" * 60 + "(first: int, *,",
        "    second: str | None = None) -> dict[str, float]",
    ]


def test_a_class_has_its_constructor_and_its_public_methods():
    assert class_lines("Shape", Shape) == [
        "Shape(sides: int)",
        "Shape.area(scale: float = 1.0) -> float",
    ]


def test_the_page_is_what_the_code_says():
    """Run python -m studies.python_names where this fails."""
    text = PAGE.read_text(encoding="utf-8")
    assert filled(text) == text


def test_a_stale_signature_is_written_anew():
    text = PAGE.read_text(encoding="utf-8")
    assert filled(text.replace("View(azimuth_deg: float, ", "View(")) == text
