"""Figures inside the page: matplotlib's SVG, reduced to shapes, text and marked parts.

A part of a figure that the page hides or names is marked when it is drawn.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from bench.report.figure import drawing
from bench.report.page import Svg, Tags
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
# Declarations of matplotlib that the style sheet makes once for all figures.
DROPPED = {"font-family", "text-anchor: start", "stroke-dashoffset: 0", "stroke-linejoin: round"}
_NUMBER = re.compile(r"-?\d+\.\d+")
_REFERENCE = re.compile(r"#([\w.-]+)")


@dataclass(frozen=True)
class MarkedPart:
    """A part of a figure that the page can hide or name.

    Attributes
    ----------
    tags : Tags
        Values by which the filters hide it.
    description : str
        Text shown where the mouse rests on it.
    series : bool
        Whether it counts for its figure, which is hidden once all such parts are hidden.
    """

    tags: Tags
    description: str = ""
    series: bool = False


@dataclass(frozen=True, eq=False)
class MarkedFigure:
    """A figure, and its marked parts by the id that they have in its SVG."""

    figure: Figure
    parts: dict[str, MarkedPart] = field(default_factory=dict)

    def mark(self, artist: Any, tags: Tags, description: str = "", *, series: bool = False) -> None:
        """Mark an artist that has been drawn."""
        name = f"part-{len(self.parts)}"
        artist.set_gid(name)
        self.parts[name] = MarkedPart(tags, description, series)

    def legend(self, columns: int, fontsize: float) -> None:
        """Draw one legend below all axes; an entry is hidden with the artist that it explains."""
        handles: dict[Any, Any] = {}
        for axis in self.figure.axes:
            handles |= {h.get_label(): h for h in axis.get_legend_handles_labels()[0]}
        legend = self.figure.legend(
            handles=list(handles.values()),
            loc="outside lower center",
            ncols=columns,
            fontsize=fontsize,
            frameon=False,
        )
        shown = zip(handles.values(), legend.legend_handles, legend.get_texts(), strict=True)
        for handle, symbol, text in shown:
            if handle.get_gid() in self.parts:
                tags = self.parts[handle.get_gid()].tags
                self.mark(symbol, tags)
                self.mark(text, tags)


def inline(drawn: MarkedFigure, name: str) -> Svg:
    """Return the SVG of a figure for the page; `name`, unlike any other, begins its ids."""
    drawn.figure.patch.set_visible(False)
    for axis in drawn.figure.axes:
        axis.patch.set_visible(False)
        axis.set_title("")
    buffer = io.StringIO()
    with drawing():
        drawn.figure.savefig(buffer, format="svg", metadata={"Date": None})
    root = ElementTree.fromstring(buffer.getvalue())
    referred = {
        id_
        for element in root.iter()
        for attribute, value in element.attrib.items()
        if attribute.endswith("href") or value.startswith("url(")
        for id_ in _REFERENCE.findall(value)
    }
    inside = [kept for child in root for kept in _kept(child, drawn.parts, referred, name)]
    width, height = (float(root.attrib["viewBox"].split()[i]) for i in (2, 3))
    return Svg(width, height, "".join(ElementTree.tostring(e, "unicode") for e in inside))


def _kept(
    element: Element, parts: dict[str, MarkedPart], referred: set[str], name: str
) -> Iterator[Element]:
    """Yield the element as the page has it, its children alone, or nothing."""
    tag = element.tag.rpartition("}")[2]
    if tag in ("metadata", "style"):
        return
    inside = [part for child in element for part in _kept(child, parts, referred, name)]
    kept = Element(tag, dict(_attributes(element, referred, name)))
    kept.text = element.text if tag in ("text", "tspan") else None
    part = parts.get(element.get("id", ""))
    if part is not None:
        kept.attrib.update(_marks(part))
        if part.description:
            title = Element("title")
            title.text = visible(part.description)
            inside.insert(0, title)
    if tag == "g" and not kept.attrib:
        yield from inside
    elif inside or tag not in ("g", "defs"):
        kept.extend(inside)
        yield kept


def _attributes(element: Element, referred: set[str], name: str) -> Iterator[tuple[str, str]]:
    # The page forbids inline styles, and its style sheet has the colours.
    attributes = dict(element.attrib)
    for declaration in filter(None, attributes.pop("style", "").split("; ")):
        key, _, value = declaration.partition(": ")
        if not {key, declaration} & DROPPED:
            attributes[key] = value
    for key, value in attributes.items():
        if key == "id":
            if value in referred:
                yield key, f"{name}-{value}"
        elif key.endswith("href") or value.startswith("url("):
            yield key.rpartition("}")[2], _REFERENCE.sub(rf"#{name}-\1", value)
        elif key in ("fill", "stroke"):
            yield key, COLOURS.get(value, value)
        elif not value.startswith("rotate(-0 "):
            yield key, _NUMBER.sub(_two_decimals, value.replace("\n", " ").strip())


def _two_decimals(number: re.Match[str]) -> str:
    return f"{float(number[0]):.2f}".rstrip("0").rstrip(".")


def _marks(part: MarkedPart) -> Iterator[tuple[str, str]]:
    """Yield the attributes that the page's script and style sheet know."""
    tags = part.tags
    for key, value in (
        ("method", tags.method),
        ("condition", tags.condition),
        ("class", tags.class_name),
    ):
        if value:
            yield f"data-{key}", visible(value)
    if part.series:
        yield "data-item", "series"
        yield "class", "series"
