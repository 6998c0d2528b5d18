"""Pages as GitHub renders them; commands and examples of README, tutorial and extending.md."""

from __future__ import annotations

import re
from collections import Counter
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
import typer
from markdown_it import MarkdownIt
from markdown_it.token import Token
from typer.core import TyperGroup

from bench.catalogue.conditions import CONDITIONS
from bench.catalogue.lookup import find
from bench.catalogue.methods import find_method
from bench.catalogue.suites import SUITES
from bench.cli import app
from tests.test_shown_commands import BLOCK, shown, typed

REPOSITORY = Path(__file__).parents[1]
DOCS = REPOSITORY / "docs"
README, TUTORIAL = REPOSITORY / "README.md", DOCS / "quickstart.md"
EXTENDING = DOCS / "extending.md"
PAGES = [
    *(README, REPOSITORY / "CONTRIBUTING.md", REPOSITORY / "CHANGELOG.md"),
    *sorted(DOCS.glob("*.md")),
    *sorted((REPOSITORY / "pc2pix" / "weights").glob("*.md")),
    *sorted((REPOSITORY / "baselines").glob("*/weights/*.md")),
]
COMMANDS = [  # of whole pages, then of those on parts that the reader writes
    pytest.param(command, page in (README, TUTORIAL), id=f"{page.stem}-{i}")
    for page in (README, TUTORIAL, EXTENDING)
    for i, command in enumerate(map(typed, shown(page)))
]
GITHUB = MarkdownIt("gfm-like", {"linkify": False})


def blocks(page: Path, language: str) -> list[str]:
    return [text for kind, text in BLOCK.findall(page.read_text()) if kind == language]


MODULE = re.compile(r"python -m ((?:studies|tests|bench)\.[\w.]+\w)")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
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


@cache
def anchors(page: Path) -> frozenset[str]:
    """Return the anchors of the headings of a page, as GitHub and MyST make them."""
    tokens = rendered(page)
    seen: Counter[str] = Counter()
    names = []
    for title in (b for a, b in pairwise(tokens) if a.type == "heading_open"):
        title = "".join(child.content for child in title.children or ())
        slug = re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-")
        names.append(f"{slug}-{seen[slug]}" if seen[slug] else slug)
        seen[slug] += 1
    return frozenset(names)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_links_lead_to_a_file_and_a_heading_of_it(page):
    dead = []
    for token in rendered(page):
        target = str(token.attrs.get("href") or token.attrs.get("src") or "")
        name, _, anchor = target.partition("#")
        place = page if not name else page.parent / name
        if not target or target.startswith(("http://", "https://")):
            continue
        if not place.exists() or (anchor and anchor not in anchors(place.resolve())):
            dead.append(target)
    assert dead == []


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


def test_the_suite_of_its_section():
    (code,) = (code for code in blocks(EXTENDING, "python") if "\nSUITE = " in code)
    names: dict[str, Any] = {"__name__": "example"}
    exec(compile(code, EXTENDING.name, "exec"), names)
    suite = names["SUITE"]
    assert suite.id not in {known.id for known in SUITES}
    for method in suite.methods:
        find_method(method)
    for condition in suite.conditions:
        find(condition, CONDITIONS, "condition")
