"""Pages as GitHub renders them; commands and examples of README, tutorial and extending.md."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
import typer
from markdown_it import MarkdownIt
from markdown_it.token import Token
from typer.core import TyperGroup

from bench.catalogue.lookup import find
from bench.catalogue.methods import find_method
from bench.catalogue.suites import SUITES
from bench.cli import app
from data_prep.clouds.conditions import CONDITIONS
from tests.test_shown_commands import BLOCK, shown, typed
from tests.test_shown_commands import PAGES as RUN

REPOSITORY = Path(__file__).parents[1]
DOCS = REPOSITORY / "docs"
README, TUTORIAL = REPOSITORY / "README.md", DOCS / "quickstart.md"
EXTENDING, HISTORY = DOCS / "extending.md", REPOSITORY / "CHANGELOG.md"
PAGES = [
    *(README, REPOSITORY / "CONTRIBUTING.md", HISTORY),
    *sorted(DOCS.glob("*.md")),
    *sorted((REPOSITORY / "pc2pix" / "weights").glob("*.md")),
    *sorted((REPOSITORY / "baselines").glob("*/weights/*.md")),
]
COMMANDS = [  # of whole pages, then of those on parts that the reader writes
    pytest.param(command, page in (README, TUTORIAL), id=f"{page.stem}-{i}")
    for page in (README, TUTORIAL, EXTENDING)
    for i, command in enumerate(map(typed, shown(page)))
]
COMPARED = {*RUN, DOCS / "compare.md"}  # the latter by tests/bench/tables/test_verdict.py
GITHUB = MarkdownIt("gfm-like", {"linkify": False})


def blocks(page: Path, language: str) -> list[str]:
    return [text for kind, text in BLOCK.findall(page.read_text()) if kind == language]


# What begins a line of a block: a command, a comment, lines left out, or a line that goes on.
COMMAND = re.compile(r"(bench|cd|make|pip|python|ray|torchrun|\.) |#|…|$| ")
MODULE = re.compile(r"python -m ((?:studies|tests|bench)\.[\w.]+\w)")


@pytest.mark.parametrize("page", [README, *sorted(DOCS.glob("*.md"))], ids=lambda page: page.stem)
def test_what_commands_print_is_compared(page):
    """A block without a language has commands only, and a `text` block is an output."""
    lines = "".join(blocks(page, "")).splitlines()
    assert [line for line in lines if not COMMAND.match(line)] == []
    assert page in COMPARED or blocks(page, "text") == []


@pytest.mark.parametrize("page", sorted({*PAGES} - {HISTORY}), ids=lambda page: page.stem)
def test_modules_that_a_page_runs_exist_or_have_their_commit(page):
    for paragraph in page.read_text().split("\n\n"):
        for name in MODULE.findall(paragraph):
            exists = (REPOSITORY / name.replace(".", "/")).with_suffix(".py").exists()
            assert exists or re.search("ommit [0-9a-f]{7}", paragraph), name


def parse(arguments: list[str]) -> None:
    """Raises what the command line would refuse them with."""
    command: Any = typer.main.get_command(app)
    name, rest = "bench", arguments
    while isinstance(command, TyperGroup):
        name, *rest = rest
        command = command.get_command(None, name)  # type: ignore[arg-type]
        assert command is not None, name
    command.make_context(name, rest)


@cache
def rendered(page: Path) -> tuple[Token, ...]:
    """Return the tokens of a page, with those inside of paragraphs after their paragraph."""
    tokens = GITHUB.parse(page.read_text(encoding="utf-8"))
    return tuple(t for token in tokens for t in (token, *(token.children or ())))


def text_of(token: Token) -> str:
    return "".join(child.content for child in token.children or ())


@cache
def anchors(page: Path) -> frozenset[str]:
    """Return the anchors of the headings of a page, as GitHub and MyST make them."""
    tokens = rendered(page)
    titles = [text_of(b) for a, b in pairwise(tokens) if a.type == "heading_open"]
    seen: Counter[str] = Counter()
    names = []
    for title in titles:
        slug = re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-")
        names.append(f"{slug}-{seen[slug]}" if seen[slug] else slug)
        seen[slug] += 1
    return frozenset(names)


def targets(page: Path) -> Iterator[str]:
    for token in rendered(page):
        target = token.attrs.get("href") or token.attrs.get("src")
        if target:
            yield str(target)


def dead_links(page: Path) -> list[str]:
    """Return the links and images of a page that lead to no file or to no heading of it."""
    dead = []
    for target in targets(page):
        name, _, anchor = target.partition("#")
        place = page if not name else page.parent / name
        if target.startswith(("http://", "https://")):
            continue
        if not place.exists() or (anchor and anchor not in anchors(place.resolve())):
            dead.append(target)
    return dead


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_links_lead_somewhere(page):
    assert dead_links(page) == []


def test_dead_links_are_found(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(
        "# A `b` c\n\n# A b c\n\n[1](#a-b-c) [2](#a-b-c-1) [3](#gone) [4](gone.md) [5](page.md#a)\n"
    )
    assert dead_links(page) == ["#gone", "gone.md", "page.md#a"]


@pytest.mark.parametrize(("command", "known"), COMMANDS)
def test_the_command_line_takes_the_commands(command, known):
    parse(command)
    options = dict(pairwise(command)) if known else {}
    for option in ("--methods", "--method"):
        for method in filter(None, options.get(option, "").split(",")):
            find_method(method)
    for condition in filter(None, options.get("--conditions", "").split(",")):
        find(condition, CONDITIONS, "condition")


def test_the_page_shows_parts_of_the_examples():
    files = "".join(path.read_text() for path in (REPOSITORY / "examples").rglob("*.py"))
    shown_parts = [
        code
        for code in blocks(EXTENDING, "python")
        if "METRIC" in code or "Hull" in code or "CONDITION" in code
    ]
    assert len(shown_parts) == 3
    for code in shown_parts:
        assert code in files


def example(name: str) -> Any:
    """Return what the one Python block of docs/extending.md that defines a name gives it."""
    (code,) = (code for code in blocks(EXTENDING, "python") if f"\n{name} = " in code)
    names: dict[str, object] = {"__name__": "example"}
    exec(compile(code, EXTENDING.name, "exec"), names)
    return names[name]


def test_the_suite_of_its_section():
    suite = example("SUITE")
    assert suite.id not in {known.id for known in SUITES}
    for method in suite.methods:
        find_method(method)
    for condition in suite.conditions:
        find(condition, CONDITIONS, "condition")
    for table in suite.tables:
        assert "Table" not in table.title  # of the paper
