"""README, the tutorial and the pages on extending: their commands, examples and links."""

from __future__ import annotations

import re
import sys
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer
from typer.core import TyperGroup

from bench.catalogue.lookup import find
from bench.catalogue.methods import find_method
from bench.catalogue.suites import SUITES
from bench.cli import app
from data_prep.clouds.conditions import CONDITIONS
from data_prep.datasets.dataset import Dataset
from data_prep.files.clouds import load_points
from data_prep.randomness import generator
from data_prep.scene import PointCloud
from tests.test_shown_commands import BLOCK, shown, typed

REPOSITORY = Path(__file__).parents[1]
DOCS = REPOSITORY / "docs"
README, TUTORIAL = REPOSITORY / "README.md", DOCS / "quickstart.md"
PAGES = [
    *(README, REPOSITORY / "CONTRIBUTING.md", REPOSITORY / "CHANGELOG.md"),
    *sorted(DOCS.glob("*.md")),
    *sorted((REPOSITORY / "pc2pix" / "weights").glob("*.md")),
    *sorted((REPOSITORY / "baselines" / "splat_net" / "weights").glob("*.md")),
]
COMMANDS = [  # of whole pages, then of those on parts that the reader writes
    pytest.param(command, page in (README, TUTORIAL), id=f"{page.stem}-{i}")
    for page in (README, TUTORIAL, *sorted(DOCS.glob("adding-*.md")))
    for i, command in enumerate(map(typed, shown(page)))
]


def blocks(page: Path, language: str) -> list[str]:
    return [text for kind, text in BLOCK.findall(page.read_text()) if kind == language]


def parse(arguments: list[str]) -> None:
    """Raises what the command line would refuse them with."""
    command: Any = typer.main.get_command(app)
    name, rest = "bench", arguments
    while isinstance(command, TyperGroup):
        name, *rest = rest
        command = command.get_command(None, name)  # type: ignore[arg-type]
        assert command is not None, name
    command.make_context(name, rest)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_links_lead_somewhere(page):
    text = BLOCK.sub("", page.read_text())
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        if not target.startswith("http"):
            name, _, anchor = target.partition("#")
            place = page if not name else page.parent / name
            assert place.exists(), target
            if anchor:
                titles = re.findall(r"^#+ (.*)$", place.read_text(), re.MULTILINE)
                assert anchor in {slug(title) for title in titles}, target


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_pages_hold_no_directives_which_github_would_show(page):
    assert re.findall(r"^(?:```|:::)\{.*", page.read_text(), re.MULTILINE) == []


def slug(title: str) -> str:
    """As GitHub and MyST make the anchor of a heading."""
    return re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-")


@pytest.mark.parametrize(("command", "known"), COMMANDS)
def test_the_command_line_takes_the_commands(command, known):
    parse(command)
    options = dict(pairwise(command)) if known else {}
    for option in ("--methods", "--method"):
        for method in filter(None, options.get(option, "").split(",")):
            find_method(method)
    for condition in filter(None, options.get("--conditions", "").split(",")):
        find(condition, CONDITIONS, "condition")


@pytest.mark.parametrize(
    ("command", "problem"),
    [
        (["run", "--suit", "speed"], "No such option: --suit"),
        (["report"], "directory"),
        (["train", "gan", "--steps", "few"], "valid integer"),
        (["rum"], "rum"),
    ],
)
def test_a_wrong_command_is_noticed(command, problem):
    with pytest.raises(Exception, match=problem):
        parse(command)


def test_the_sample_cloud_is_made_as_its_page_says(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (script,) = blocks(DOCS / "rendering.md", "python")
    exec(compile(script, "rendering.md", "exec"), {})
    sample = load_points(REPOSITORY / "examples" / "chair.ply")
    assert sample.shape == (2048, 3)
    np.testing.assert_allclose(load_points(Path("chair.ply")), sample, atol=1e-6)


def example(page: str) -> dict[str, object]:
    """What the Python block of a page defines."""
    (code,) = blocks(DOCS / page, "python")
    names: dict[str, object] = {"__name__": "example"}
    exec(compile(code, page, "exec"), names)
    return names


def test_the_condition_of_its_page(monkeypatch):
    monkeypatch.setitem(sys.modules, "example", sys)
    condition = example("adding-a-condition.md")["CONDITION"]
    points = np.array([[0.074, -0.02, 0.51], [0.026, 0, 1]], np.float32)
    made = condition.perturbation.apply(PointCloud(points), generator(0))
    assert made.points.dtype == np.float32
    np.testing.assert_allclose(made.points, [[0.05, 0, 0.5], [0.05, 0, 1]], atol=1e-6)
    assert repr(condition.perturbation) == "Rounded(step=0.05)"
    assert condition.id not in {known.id for known in CONDITIONS}


def test_the_suite_of_its_page():
    suite = example("adding-a-suite.md")["SUITE"]
    assert suite.id not in {known.id for known in SUITES}
    for method in suite.methods:
        find_method(method)
    for condition in suite.conditions:
        find(condition, CONDITIONS, "condition")
    page = (DOCS / "adding-a-suite.md").read_text()
    for field in SUITES[0].__dataclass_fields__.keys() - {"id", "about"}:
        assert f"`{field}`" in page


def test_the_dataset_of_its_page(tmp_path):
    read = example("adding-a-dataset.md")["DATASET"].read
    (tmp_path / "objects.csv").write_text("train,chair,a.obj\ntest,chair,b.obj\ntest,lamp,c.obj\n")
    dataset = read("list:here", tmp_path)
    assert isinstance(dataset, Dataset)
    assert dataset.classes == ("chair", "lamp")
    assert [o.object_id for o in dataset.objects("chair", None, 1)] == ["b.obj"]
    for wrong in ("", "test,chair\n", "tset,chair,a.obj\n", "test,chair,../a.obj\n"):
        (tmp_path / "objects.csv").write_text(wrong)
        with pytest.raises(ValueError):
            read("list:here", tmp_path)
