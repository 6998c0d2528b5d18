"""Signatures of the public Python names, written into docs/api.md.

    python -m studies.python_names

A heading of the page is a name; the signature and the first sentence of its docstring below it are
written anew.
"""

from __future__ import annotations

import inspect
import re
import textwrap
from dataclasses import is_dataclass
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

from data_prep.files.atomic_write import write_whole

PAGE = Path(__file__).parents[1] / "docs" / "api.md"
ENTRY = re.compile(r"^### `([\w.]+)`\n(?:(?!#).*\n)*", re.MULTILINE)
WIDTH = 90
_KEPT_SPACE = "\0"


class _Unquoted(str):
    """An annotation that a signature shows without quotation marks."""

    __slots__ = ()

    def __repr__(self) -> str:
        """Return the text itself."""
        return str(self)


def _unquoted(annotation: Any) -> Any:
    """Return an annotation without quotation marks where it is a string."""
    return _Unquoted(annotation) if isinstance(annotation, str) else annotation


def _short(default: Any) -> Any:
    """Return a default, without the fields of an object that is made without arguments."""
    try:
        made_anew = is_dataclass(default) and default == type(default)()
    except TypeError:
        return default
    return _Unquoted(f"{type(default).__name__}()") if made_anew else default


def call(name: str, function: Any, is_class: bool = False) -> str:
    """Return a name with its parameters, wrapped; of a class without what it returns."""
    signature = inspect.signature(function)
    parameters = [
        p.replace(annotation=_unquoted(p.annotation), default=_short(p.default))
        for p in signature.parameters.values()
        if p.name != "self"
    ]
    returned = signature.empty if is_class else _unquoted(signature.return_annotation)
    text = name + str(signature.replace(parameters=parameters, return_annotation=returned))
    # Lines break between parameters, not inside of one.
    whole = re.sub(r"(?<!,) (?!->)", _KEPT_SPACE, text)
    lines = textwrap.wrap(whole, WIDTH, subsequent_indent="    ", break_on_hyphens=False)
    return "\n".join(lines).replace(_KEPT_SPACE, " ")


def _class_lines(name: str, cls: type) -> list[str]:
    """Return the constructor of a class, or its base where it has none, and its public methods."""
    if issubclass(cls, Exception) and "__init__" not in vars(cls):
        lines = [f"class {name}({cls.__bases__[0].__name__})"]
    elif getattr(cls, "_is_protocol", False):
        lines = [f"class {name}(Protocol)"]
    else:
        lines = [call(name, cls, is_class=True)]
    methods = {key: value for key, value in vars(cls).items() if inspect.isfunction(value)}
    return lines + [
        call(f"{name}.{key}", method) for key, method in methods.items() if not key.startswith("_")
    ]


def entry(path: str) -> str:
    """Return the section of one public name: heading, signature and sentence."""
    thing = resolve_name(path)
    name = path.rpartition(".")[2]
    lines = _class_lines(name, thing) if inspect.isclass(thing) else [call(name, thing)]
    sentence = (inspect.getdoc(thing) or "").splitlines()[0]
    code = "\n".join(["```python", *lines, "```"])
    return f"### `{path}`\n\n{code}\n\n{sentence}\n\n"


def filled(text: str) -> str:
    """Return a page with the section below each heading of a name written anew."""
    return ENTRY.sub(lambda match: entry(match[1]), text).rstrip("\n") + "\n"


if __name__ == "__main__":
    write_whole(PAGE, filled(PAGE.read_text(encoding="utf-8")).encode())
