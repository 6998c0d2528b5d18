"""The pages of a site as plain values, and how these become HTML files.

All text is escaped by the template; model cards, which are Markdown, may hold no HTML.
"""

from __future__ import annotations

import base64
import re
from collections.abc import Sequence
from dataclasses import dataclass
from hashlib import sha256
from html import escape
from typing import Any

from bench.report.page import bundled, rendered
from bench.tables.grid import Grid

Link = tuple[str, str]  # text and file
_COMMENT = re.compile(r"<!--.*?-->\n?", re.DOTALL)
_SHIFT = 2  # a card's first heading is of the third level


@dataclass(frozen=True)
class Section:
    """A part of a page; `trusted` is HTML, of `card_html`."""

    title: str
    about: str = ""
    grids: tuple[Grid, ...] = ()
    links: tuple[Link, ...] = ()
    images: tuple[Link, ...] = ()
    trusted: str = ""


@dataclass(frozen=True)
class SitePage:
    """A page, in a file of the site's one folder."""

    file: str
    title: str
    kicker: str
    about: str
    facts: tuple[tuple[str, str], ...]
    sections: tuple[Section, ...]


def site_html(page: Any, menu: Sequence[Link], index: bool = False) -> str:
    """Return a page as an HTML document that loads only images beside it.

    The index has a script that sorts its table, the others have none.
    """
    from markupsafe import Markup

    style = bundled("site.css")
    template = "site-index.html.jinja" if index else "site.html.jinja"
    script = {"script": bundled("site.js")} if index else {}
    digest = base64.b64encode(sha256(style.encode()).digest()).decode()
    return rendered(
        template, page=page, menu=menu, site_style=Markup(style),
        site_style_hash=f"sha256-{digest}", **script,
    )  # fmt: skip


def card_html(markdown: str) -> str:
    """Return a model card as HTML: tables can be scrolled, and HTML in it is escaped.

    Links are their text alone, because they lead into the repository.
    """
    from markdown_it import MarkdownIt

    def no_tag(*_: Any) -> str:
        return ""

    reader = MarkdownIt("commonmark", {"html": False}).enable("table")
    for name in ("link_open", "link_close"):
        reader.add_render_rule(name, no_tag)
    tables = iter(range(1, 1000))
    reader.add_render_rule(
        "table_open",
        lambda *_: (
            f'<div class="scroll" role="region" aria-label="Table {next(tables)} of the card" '
            'tabindex="0"><table>'
        ),
    )
    reader.add_render_rule("table_close", lambda *_: "</table></div>")
    blocks = iter(range(1, 1000))
    reader.add_render_rule(
        "fence",
        lambda _, tokens, at, *rest: (
            f'<pre role="region" aria-label="Lines {next(blocks)} of the card" tabindex="0"><code>'
            f"{escape(tokens[at].content)}</code></pre>\n"
        ),
    )
    reader.disable("image")
    tokens = reader.parse(_COMMENT.sub("", markdown))
    for token, following, end in zip(tokens, tokens[1:], tokens[2:], strict=False):
        if "style" in token.attrs:  # which the page does not allow
            token.attrs = {"class": "right"} if "right" in str(token.attrs["style"]) else {}
        if token.type == "th_open" and not following.content:  # a header that says nothing is none
            token.tag = end.tag = "td"
        if token.type in ("heading_open", "heading_close"):
            token.tag = f"h{min(6, int(token.tag[1]) + _SHIFT)}"
    return str(reader.renderer.render(tokens, reader.options, {}))
