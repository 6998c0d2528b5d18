"""Sphinx configuration: `make docs` builds docs/ into build/docs."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

from docutils.nodes import document, image

sys.path.insert(0, str(Path(__file__).parents[1]))  # `studies` is not installed

project = "pc2pix-bench"
author = "the authors of pc2pix-bench"
extensions = ["myst_parser", "sphinx_copybutton", "studies.leaderboard"]
source_suffix = {".md": "markdown"}
exclude_patterns: list[str] = []
html_theme = "furo"
html_title = "pc2pix-bench"
html_show_copyright = False
highlight_language = "bash"  # most blocks are commands; Python is said to be Python
myst_heading_anchors = 3
OUTSIDE = {"maintaining"}  # of the navigation, which is for users
suppress_warnings = ["myst.header"]  # pages begin at the level that their place in a page has


def link_images(app: Any, page: document) -> None:
    """Make images as wide as the text; Sphinx links one of a stated width to its full size."""
    for node in page.findall(image):
        node["width"] = "100%"


def add_navigation(app: Any, page: str, source: list[str]) -> None:
    """Add the navigation, made from the lists of the index, which GitHub shows as they stand."""
    if page == "index":
        head, *sections = re.split(r"^(?=## )", source[0], flags=re.MULTILINE)
        source[0] = head + "".join(section + contents(section) for section in sections)
    elif page in OUTSIDE:
        source[0] = f"---\norphan: true\n---\n\n{source[0]}"


def contents(section: str) -> str:
    """Return a hidden table of contents of the pages that a section links as a whole."""
    caption = section.partition("\n")[0].removeprefix("## ")
    pages = "\n".join(re.findall(r"\]\(([\w-]+)\.md\)", section))
    if not pages:  # the gallery, which links to sections
        return ""
    return f"\n```{{toctree}}\n:hidden:\n:caption: {caption}\n\n{pages}\n```\n\n"


def setup(app: Any) -> None:
    """Connect the functions above to the steps of a build."""
    app.connect("source-read", add_navigation)
    app.connect("doctree-read", link_images)
