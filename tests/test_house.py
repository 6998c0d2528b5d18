"""The rules of CONTRIBUTING.md, section "How the code reads", counted over the source."""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGES = ("data_prep", "learning", "baselines", "pc2pix", "bench", "studies")
RULE = 'CONTRIBUTING.md, "How the code reads"'

# A summary line that opens with one of these is no sentence with a verb, and no noun of a thing.
FRAGMENT = re.compile(
    r"(Also|As|By|Each|For|From|Half|How|In|It|Its|Likewise|None|Of|On|Same|Some|Such|The same"
    r"|Their|Theirs|These|Those|To|What|Where|Whether|Which|Who|Whose|With|Without)\b"
)
# Names that hold anything, and so name nothing.
VAGUE = {"there", "found", "made", "todo", "own", "one", "of"}
# Names that had several meanings; the right one has the name that means one.
OLD_NAMES = re.compile(
    r"SoFar|so_far|Measured|Finished|Watch|Observer|look_ahead|do|do_jobs|Lost|Lacking|"
    r"Broken|circumstances|Stated|takes|Unstated|Scored|Timed|Seen|see|Checked|Moved|rival|"
    r"lead|trade|beside_paper|crossings|announced_ids|whole_file|oddities|unpainted|painted|"
    r"endless|Found|control_table|Line|Mark|Place|Thinned|LeftOut|left_out|MeasuredFeatures|"
    r"say|Item"
)
# In the augmentation it is the verb: to paint a mesh.
STAYS = {"data_prep/shapes/augmentation.py:painted"}
MOST_LINES = 400
MOST_PARAMETERS = 7
# Signatures of another library, and shapes whose text is frozen.
MORE_PARAMETERS = {
    "learning/convolution.py:__init__",
    "data_prep/shapes/furniture.py:legs",
    "data_prep/shapes/sitting_bench/indoor.py:_shell",
}
# Class names that two files define: each is private to its file, or a part of a report or a shape.
TWICE = {"Case", "Grid", "Outputs", "Proportions"}


@cache
def sources() -> dict[str, ast.Module]:
    paths = sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))
    return {str(p.relative_to(ROOT)): ast.parse(p.read_text("utf-8")) for p in paths}


def nodes(*kinds: type[ast.AST]) -> Iterator[tuple[str, ast.AST]]:
    for file, tree in sources().items():
        for node in ast.walk(tree):
            if isinstance(node, kinds):
                yield file, node


def fragments(tree: ast.Module) -> list[str]:
    """Return the summary lines of modules, classes and functions that open with a fragment."""
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef)
    texts = (ast.get_docstring(n) for n in ast.walk(tree) if isinstance(n, documented))
    return [text.splitlines()[0] for text in texts if text and FRAGMENT.match(text)]


def test_a_fragment_is_recognised():
    source = '"""Methods."""\ndef f():\n    """What it does."""\ndef g():\n    """Return it."""\n'
    assert fragments(ast.parse(source)) == ["What it does."]


def test_summary_lines_are_sentences():
    lines = [f"{file}: {line}" for file, tree in sources().items() for line in fragments(tree)]
    assert lines == [], f"begin with a verb (functions) or a noun (classes): {RULE}"


def test_variables_are_named_after_what_they_hold():
    vague = [
        f"{file}:{node.lineno} {node.id}"
        for file, node in nodes(ast.Name)
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store) and node.id in VAGUE
    ]
    assert vague == [], RULE


def test_old_names_are_gone():
    defined = {
        f"{file}:{node.name}"
        for file, node in nodes(ast.ClassDef, ast.FunctionDef)
        if isinstance(node, ast.ClassDef | ast.FunctionDef) and OLD_NAMES.fullmatch(node.name)
    }
    assert defined <= STAYS, f"one name, one meaning: {RULE}"


def test_a_class_name_means_one_class():
    files = defaultdict(set)
    for file, node in nodes(ast.ClassDef):
        assert isinstance(node, ast.ClassDef)
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
        parts = node.args.posonlyargs + node.args.args + node.args.kwonlyargs
        if len(parts) > MOST_PARAMETERS:
            many.add(f"{file}:{node.name}")
    assert many == MORE_PARAMETERS, f"a frozen dataclass holds what belongs together: {RULE}"


@pytest.mark.parametrize("name", sorted(STAYS))
def test_exceptions_are_still_needed(name):
    file, _, function = name.partition(":")
    assert function in {n.name for n in ast.walk(sources()[file]) if isinstance(n, ast.FunctionDef)}
