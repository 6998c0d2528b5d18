"""Pages as HTML, and figures in them: templates escape all text, and forbid what is not there."""

from __future__ import annotations

import base64
import hashlib
import io
import json
import re
from functools import cache
from importlib import resources
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from bench.report.plots import LEGEND, drawing
from bench.report.styles import HUES, INK, PAPER, RULE, SHADE, SOFT
from bench.tables.markdown import visible

if TYPE_CHECKING:
    from jinja2 import Environment
    from matplotlib.figure import Figure

_COLOURS = {  # variables of the style sheet in place of the colours that figures are drawn in
    INK: "currentColor",
    PAPER: "var(--paper)",
    SOFT: "var(--soft)",
    RULE: "var(--rule)",
    SHADE: "var(--sunk)",
    **{hue: f"var(--hue-{number})" for number, hue in enumerate(HUES)},
}
_REFERENCE = re.compile(r"#([\w.-]+)")  # of one element of an SVG to another, by its id


def rendered(template: str, **values: Any) -> str:
    """Return a page: a template of the assets with values, the style sheet and the script.

    The page loads nothing, and equal values give equal text. Names and reasons may hold any text:
    every value is escaped but `style`, a style sheet in place of that of whole pages. `scripts` are
    the assets that a page has as its script.
    """
    from markupsafe import Markup

    script = "".join(map(bundled, values.pop("scripts", ("report.js",))))
    style = values.pop("style", bundled("report.css") + bundled("tables.css"))
    for name, text in {"style": style, "script": script}.items():
        values |= {name: Markup(text), f"{name}_hash": _hash(text)}
    return _environment().get_template(template).render(**values) + "\n"


@cache
def _environment() -> Environment:
    """Return the environment of all templates, which keeps those that it has compiled."""
    from jinja2 import Environment, FunctionLoader, StrictUndefined
    from markupsafe import Markup, escape

    def harmless(value: Any) -> Any:
        return visible(value) if isinstance(value, str) and not isinstance(value, Markup) else value

    def unbroken(text: str) -> Markup:
        return Markup(str(escape(visible(text))).replace(" %", "&nbsp;%"))

    environment = Environment(
        loader=FunctionLoader(bundled),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=harmless,
    )
    environment.filters["trusted"] = Markup
    environment.filters["unbroken"] = unbroken
    return environment


def bundled(name: str) -> str:
    """Return the text of an asset."""
    return resources.files("bench.report").joinpath("assets", name).read_text(encoding="utf-8")


def _hash(text: str) -> str:
    """Return the hash by which a Content-Security-Policy names inline text."""
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


def inline(figure: Figure, name: str, description: str) -> str:
    """Return a figure as an SVG element.

    name         begins the ids of its elements: no other figure of the page has it
    description  what the figure shows in words, for readers who do not see it

    Marks have the attribute `data-method`, and a `<title>` each; names in the legend have
    `data-legend`. Text in it is escaped, and control characters are visible. Inline styles, which
    the page's security policy forbids, become attributes.
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
        known = attributes.get("id", "")
        if known.startswith("["):  # marks, see `bench.report.plots.marks_id`
            attributes["data-method"], *titles = json.loads(known)
            marks = [element for element in parent.iter() if element.tag.endswith("}use")]
            for marked, title in zip(marks or [parent], titles, strict=False):
                SubElement(marked, "title").text = visible(title)
        elif known.startswith(LEGEND):
            attributes["data-legend"] = known.removeprefix(LEGEND)
        for declaration in filter(None, attributes.pop("style", "").split("; ")):
            key, _, value = declaration.partition(": ")
            attributes[key] = _COLOURS.get(value, value)
        if not parent.tag.endswith(("path", "Path")):
            attributes.pop("id", None)  # of groups, which nothing refers to
        attributes.pop("font-family", None)
        parent.attrib.clear()
        for key, value in attributes.items():
            if key == "id":
                value = f"{name}-{value}"
            elif key.endswith("href") or value.startswith("url("):
                value = _REFERENCE.sub(rf"#{name}-\1", value)
            parent.attrib[key.rpartition("}")[2]] = value
    root.attrib = {"viewBox": box, "role": "img", "aria-labelledby": f"{name}-description"}
    words = Element("desc", id=f"{name}-description")
    words.text = visible(description)
    root.insert(0, words)
    return ElementTree.tostring(root, "unicode")
