"""The signatures of public Python names, which this study writes into docs/api.md.

    python -m studies.python_names

Each heading of that page is a name. What stands below it, the signature and the first sentence of
the docstring, is replaced by that of the code.
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
WIDTH = 90  # characters of a line of code
_KEPT_SPACE = "\0"  # stands for a space at which a line must not break


class _Unquoted(str):
    """An annotation that a signature shows without quotation marks."""

    __slots__ = ()

    def __repr__(self) -> str:
        """Return the text itself."""
        return str(self)


def _unquoted(annotation: Any) -> Any:
    """Return an annotation that is shown without quotation marks, also where it is a string."""
    return _Unquoted(annotation) if isinstance(annotation, str) else annotation


def _short(default: Any) -> Any:
    """Return a default as it is shown: an object made without arguments without its fields."""
    try:
        made_anew = is_dataclass(default) and default == type(default)()
    except TypeError:
        return default
    return _Unquoted(f"{type(default).__name__}()") if made_anew else default


def call(name: str, function: Any, is_class: bool = False) -> str:
    """Return the call of a function or class as lines of code: name, parameters and result.

    name      as the call has it
    is_class  whether it is a class, whose result is left out
    """
    signature = inspect.signature(function)
    parameters = []
    for parameter in signature.parameters.values():
        if parameter.name != "self":
            annotation, default = _unquoted(parameter.annotation), _short(parameter.default)
            parameters.append(parameter.replace(annotation=annotation, default=default))
    returned = signature.empty if is_class else _unquoted(signature.return_annotation)
    text = name + str(signature.replace(parameters=parameters, return_annotation=returned))
    # Lines may break after the comma of a parameter and before "->", and at no other space.
    whole = re.sub(r"(?<!,) (?!->)", _KEPT_SPACE, text)
    lines = textwrap.wrap(whole, WIDTH, subsequent_indent="    ", break_on_hyphens=False)
    return "\n".join(lines).replace(_KEPT_SPACE, " ")


def _class_lines(name: str, cls: type) -> list[str]:
    """Return the constructor of a class and its public methods, as lines of code.

    Exceptions without a constructor are shown by their base class, protocols as such.
    """
    if issubclass(cls, Exception) and "__init__" not in vars(cls):
        lines = [f"class {name}({cls.__bases__[0].__name__})"]
    elif getattr(cls, "_is_protocol", False):
        lines = [f"class {name}(Protocol)"]
    else:
        lines = [call(name, cls, is_class=True)]
    for key, value in vars(cls).items():
        if inspect.isfunction(value) and not key.startswith("_"):
            lines.append(call(f"{name}.{key}", value))
    return lines


def entry(path: str) -> str:
    """Return the section of one public name, given by its path: "data_prep.scene.View"."""
    thing = resolve_name(path)
    name = path.rpartition(".")[2]
    lines = _class_lines(name, thing) if inspect.isclass(thing) else [call(name, thing)]
    sentence = (inspect.getdoc(thing) or "").splitlines()[0]
    code = "\n".join(["```python", *lines, "```"])
    return f"### `{path}`\n\n{code}\n\n{sentence}\n\n"


def filled(text: str) -> str:
    """Return the text of a page whose sections of names are written anew."""
    return ENTRY.sub(lambda match: entry(match[1]), text).rstrip("\n") + "\n"


if __name__ == "__main__":
    write_whole(PAGE, filled(PAGE.read_text(encoding="utf-8")).encode())
