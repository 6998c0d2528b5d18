"""The rules of CONTRIBUTING.md, section "How the code reads", counted over the source."""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parent.parent
PACKAGES = ("data_prep", "learning", "baselines", "pc2pix", "bench", "studies")
RULE = 'CONTRIBUTING.md, "How the code reads"'

# Names that hold anything, and so name nothing.
VAGUE = {"there", "found", "made", "todo", "own", "one", "of"}
MOST_LINES = 600
MOST_PARAMETERS = 7  # by position; keywords name themselves
MORE_PARAMETERS = {"data_prep/shapes/sitting_bench/indoor.py:_shell"}  # shapes: frozen text
# Class names that two files define: each is private to its file, or a part of a report or a shape.
TWICE = {"Outputs", "Proportions"}


@cache
def sources() -> dict[str, ast.Module]:
    paths = sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))
    return {str(p.relative_to(ROOT)): ast.parse(p.read_text("utf-8")) for p in paths}


def nodes(*kinds: type[ast.AST]) -> Iterator[tuple[str, ast.AST]]:
    for file, tree in sources().items():
        for node in ast.walk(tree):
            if isinstance(node, kinds):
                yield file, node


def test_variables_are_named_after_what_they_hold():
    vague = [
        f"{file}:{node.lineno} {node.id}"
        for file, node in nodes(ast.Name)
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store) and node.id in VAGUE
    ]
    assert vague == [], RULE


def test_a_class_name_means_one_class():
    files = defaultdict(set)
    for file, node in nodes(ast.ClassDef):
        assert isinstance(node, ast.ClassDef)
        if not node.name.startswith("_"):
            files[node.name].add(file)
    assert {name for name, where in files.items() if len(where) > 1} == TWICE, RULE


def test_files_are_short():
    lines = {file: len((ROOT / file).read_text("utf-8").splitlines()) for file in sources()}
    long = {file: count for file, count in lines.items() if count > MOST_LINES}
    assert long == {}, f"divide them where their text divides: {RULE}"


def test_functions_have_few_parameters():
    many = set()
    for file, node in nodes(ast.FunctionDef):
        assert isinstance(node, ast.FunctionDef)
        if len(node.args.posonlyargs + node.args.args) > MOST_PARAMETERS:
            many.add(f"{file}:{node.name}")
    assert many == MORE_PARAMETERS, f"a frozen dataclass holds what belongs together: {RULE}"
