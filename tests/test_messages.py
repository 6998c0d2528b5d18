"""What every error for the user says: what is wrong, with the value, and what to do about it."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FILES = [
    path
    for package in ("bench", "pc2pix", "baselines", "learning", "data_prep")
    for path in sorted((ROOT / package).rglob("*.py"))
]
REMEDY = re.compile(
    r"; (?!$)"  # after what is wrong: what to do
    r"|must be |expected |: give |: use |there are "  # or the values that there are
)


def text_of(node: ast.expr, value: str = "V") -> str:
    """The text of a message, each value in it as `value`."""
    if isinstance(node, ast.Constant):
        return str(node.value)
    if isinstance(node, ast.JoinedStr):
        return "".join(text_of(part, value) for part in node.values)
    if isinstance(node, ast.BinOp):
        return text_of(node.left, value) + text_of(node.right, value)
    return value


def messages() -> list[object]:
    """Every `BadInput(message)` of the packages that states its own message."""
    found = []
    for path in FILES:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "BadInput":
                where = f"{path.relative_to(ROOT)}:{node.lineno}"
                found.append(pytest.param(text_of(node.args[0]), id=where))
    return found


ALL = messages()
PASSED_ON = re.compile(r"(V: )?V")  # the message of another error, behind the name of the file


@pytest.mark.parametrize("message", ALL)
def test_it_is_one_line_that_names_a_value_and_a_remedy(message):
    assert message.isprintable()
    assert not message.endswith(".")
    if PASSED_ON.fullmatch(message):
        return
    assert "V" in message or "--" in message or "(0)" in message or "docs/" in message
    assert REMEDY.search(message), message
