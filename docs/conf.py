"""Sphinx configuration: `make docs` builds docs/ into build/docs."""

from __future__ import annotations

import re
from itertools import groupby
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


def setup(app: Any) -> None:
    """Called by Sphinx."""
    app.connect("doctree-read", link_pictures)
    app.connect("autodoc-process-docstring", show_plain)
