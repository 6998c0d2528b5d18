"""Figures inside the page: matplotlib's SVG, whose colours follow light and dark."""

from __future__ import annotations

import io
import re
from typing import TYPE_CHECKING
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from bench.report.figure import drawing
from bench.report.styles import HUES, INK, PAPER, RULE, SHADE, SOFT
from bench.tables.markdown import visible

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLOURS = {
    INK: "currentColor",
    PAPER: "var(--paper)",
    SOFT: "var(--soft)",
    RULE: "var(--rule)",
    SHADE: "var(--sunk)",
    **{hue: f"var(--hue-{number})" for number, hue in enumerate(HUES)},
}
_REFERENCE = re.compile(r"#([\w.-]+)")


def inline(figure: Figure, name: str, description: str) -> str:
    """Return a figure as an SVG element; `name`, unlike any other, begins its ids.

    Text in it is escaped, and control characters are visible. The page forbids inline styles: they
    become attributes. `description` has its content in words.
    """
    figure.patch.set_visible(False)
    for axis in figure.axes:
        axis.patch.set_visible(False)
    buffer = io.StringIO()
    with drawing():
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    root = ElementTree.fromstring(buffer.getvalue())
    box = root.attrib["viewBox"]
    for parent in list(root.iter()):
        for child in list(parent):
            if child.tag.endswith(("}metadata", "}style")):
                parent.remove(child)
        parent.tag = parent.tag.rpartition("}")[2]
        attributes = dict(parent.attrib)
        for declaration in filter(None, attributes.pop("style", "").split("; ")):
            key, _, value = declaration.partition(": ")
            attributes[key] = COLOURS.get(value, value)
        if not parent.tag.endswith(("path", "Path")):
            attributes.pop("id", None)  # of groups, which nothing refers to
        attributes.pop("font-family", None)
        parent.attrib = {
            key.rpartition("}")[2]: f"{name}-{value}"
            if key == "id"
            else _REFERENCE.sub(rf"#{name}-\1", value)
            if key.endswith("href") or value.startswith("url(")
            else value
            for key, value in attributes.items()
        }
    root.attrib = {"viewBox": box, "role": "img", "aria-labelledby": f"{name}-description"}
    words = Element("desc", id=f"{name}-description")
    words.text = visible(description)
    root.insert(0, words)
    return ElementTree.tostring(root, "unicode")
