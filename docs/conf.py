"""Sphinx configuration: `make docs` builds docs/ into build/docs."""

from __future__ import annotations

import inspect
import re
from itertools import groupby
from pkgutil import resolve_name
from typing import Any

from docutils.nodes import document, image

project = "pc2pix-bench"
author = "the authors of pc2pix-bench"
extensions = ["myst_parser", "sphinx.ext.autodoc"]
source_suffix = {".md": "markdown"}
exclude_patterns: list[str] = []
html_theme = "furo"
html_title = "pc2pix-bench"
html_show_copyright = False
highlight_language = "none"  # commands and what they print; Python is said to be Python
myst_heading_anchors = 3
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
suppress_warnings = ["myst.header"]  # pages begin at the level that their place in a page has


def show_plain(*event: Any) -> None:
    """Docstrings are plain text: tables of names stay as they are laid out, the rest flows."""
    lines: list[str] = event[-1]
    paragraphs = [list(group) for filled, group in groupby(lines, key=bool) if filled]
    lines.clear()
    for paragraph in paragraphs:
        if any(re.search(r"\S {2,}\S|^[ -]", line) for line in paragraph):
            lines += ["::", "", *(f"    {line}" for line in paragraph), ""]
        else:
            lines += [re.sub(r"`([^`]+)`", r"``\1``", line) for line in paragraph] + [""]


def link_pictures(app: Any, page: document) -> None:
    """Pictures fill the column of text; Sphinx links those of a stated width to their full size."""
    for picture in page.findall(image):
        picture["width"] = "100%"


def add_directives(app: Any, page: str, source: list[str]) -> None:
    """Add to two pages what only Sphinx can do, since GitHub shows directives as they stand.

    The navigation is made from the lists of the index, and the text of each name of the reference
    stands below its table.
    """
    if page not in ("index", "api"):
        return
    head, *sections = re.split(r"^(?=## )", source[0], flags=re.MULTILINE)
    add = contents if page == "index" else reference
    source[0] = head + "".join(section + add(section) for section in sections)


def contents(section: str) -> str:
    """Return a hidden table of contents of the pages that a section links."""
    caption = section.partition("\n")[0].removeprefix("## ")
    pages = "\n".join(re.findall(r"\]\(([\w-]+)\.md\)", section))
    return f"\n```{{toctree}}\n:hidden:\n:caption: {caption}\n\n{pages}\n```\n\n"


def reference(section: str) -> str:
    """Return the directives for all names in the table of a section."""
    lines = []
    for name in re.findall(r"^\| `([\w.]+)`", section, re.MULTILINE):
        if inspect.isclass(resolve_name(name)):
            lines += [f".. autoclass:: {name}", "   :members:"]
        else:
            lines += [f".. autofunction:: {name}"]
    return "\n".join(["", "```{eval-rst}", *lines, "```", "", ""])


def setup(app: Any) -> None:
    """Connect the functions above to the steps of a build."""
    app.connect("source-read", add_directives)
    app.connect("doctree-read", link_pictures)
    app.connect("autodoc-process-docstring", show_plain)
