"""The option `--open`: a page that was written is shown in the browser."""

from __future__ import annotations

import sys
import webbrowser
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

OpenOption = Annotated[
    bool, typer.Option("--open/--no-open", help="Open the page in the browser at the end.")
]


def open_page(page: Path, open_url: Callable[[str], bool] = webbrowser.open) -> None:
    """Open a page in the browser; where there is none, say on stderr where the page is.

    `open_url` is `webbrowser.open`, which returns whether a browser was started.
    """
    try:
        opened = open_url(page.resolve().as_uri())
    except (OSError, ValueError, webbrowser.Error):  # ValueError: of an unbalanced $BROWSER
        opened = False
    if not opened:
        print(f"bench: no browser could be started; the page is {page}", file=sys.stderr)
