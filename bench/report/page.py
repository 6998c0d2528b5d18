"""Pages as HTML: templates that escape all text, and forbid what is not in them."""

from __future__ import annotations

import base64
import hashlib
from functools import cache
from importlib import resources
from typing import TYPE_CHECKING, Any

from bench.tables.markdown import visible

if TYPE_CHECKING:
    from jinja2 import Environment


def rendered(template: str, **values: Any) -> str:
    """Return a template of the assets with these values, style sheet, script and their checksums.

    The page loads nothing, and equal values give equal text. Names and reasons may hold anything:
    everything is escaped but `style`, which is in place of that of whole pages.
    """
    from markupsafe import Markup

    style = values.pop("style", bundled("report.css") + bundled("tables.css"))
    for name, text in {"style": style, "script": bundled("report.js")}.items():
        values |= {name: Markup(text), f"{name}_hash": _hash(text)}
    return _environment().get_template(template).render(**values) + "\n"


@cache
def _environment() -> Environment:
    """Return the environment of all templates, which keeps those that it has compiled."""
    from jinja2 import Environment, FunctionLoader, StrictUndefined
    from markupsafe import Markup, escape

    def harmless(value: Any) -> Any:
        return visible(value) if isinstance(value, str) and not isinstance(value, Markup) else value

    environment = Environment(
        loader=FunctionLoader(bundled),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=harmless,
    )
    environment.filters["trusted"] = Markup
    environment.filters["unbroken"] = lambda text: Markup(
        str(escape(visible(text))).replace(" %", "&nbsp;%")
    )
    return environment


def bundled(name: str) -> str:
    """Return the text of an asset."""
    return resources.files("bench.report").joinpath("assets", name).read_text(encoding="utf-8")


def _hash(text: str) -> str:
    """Return the hash by which a Content-Security-Policy names inline text."""
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
