"""Run the walk of docs/extending.md and the commands of llms.txt, from nothing to a verdict.

The commands are those of the pages; what is added makes the run small.
"""

from __future__ import annotations

import re
import shlex
import shutil
import sys
from pathlib import Path

import pandas as pd
import pytest
from typer.testing import CliRunner

from bench.cli import app
from tests.test_shown_commands import BLOCK

pytestmark = pytest.mark.slow

REPOSITORY = Path(__file__).parents[1]
EXTENDING, AGENTS = REPOSITORY / "docs" / "extending.md", REPOSITORY / "llms.txt"
SMALL = ["--limit", "2", "--views", "2", "--conditions", "2048", "--workers", "1"]


def lines_of(page: Path, heading: str = "") -> list[list[str]]:
    """Return the words of each line of the blocks of commands of a page, or of a section."""
    text = page.read_text(encoding="utf-8")
    if heading:
        text = text.partition(f"\n## {heading}\n")[2].partition("\n## ")[0]
    block = "".join(block for kind, block in BLOCK.findall(text) if not kind)
    lines = re.sub(r" *\\\n *", " ", block).splitlines()
    return [shlex.split(line, comments=True) for line in lines]


def walk(lines: list[list[str]], monkeypatch) -> dict[str, str]:
    """Run the lines one after the other; return the standard output of each command of `bench`."""
    printed = {}
    for program, *words in lines:
        if program == "cd":
            monkeypatch.chdir(words[0])
            continue
        assert program == "bench"
        small = SMALL if words[0] == "run" else ["--workers", "1"] * (words[0] == "add")
        ended = CliRunner().invoke(app, [*words, *small], prog_name="bench")
        assert ended.exit_code == 0, f"{words}: {ended.output}"
        printed[words[0]] = ended.stdout
    return printed


def test_the_walk_of_the_page_ends_with_a_verdict(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")
    monkeypatch.setattr(sys, "path", [*sys.path])
    printed = walk(lines_of(EXTENDING, "From nothing to a verdict"), monkeypatch)
    assert list(printed) == ["run", "new", "test", "add"]
    assert printed["test"].splitlines()[-1] == (
        "0 block a run, 0 warnings; next: bench add my_method:METHOD DIR"
    )
    lines = printed["add"].splitlines()
    assert lines[0] == "0 block a run, 0 warnings"
    assert any(line.startswith("my_method:METHOD  ") for line in lines)  # its values
    places = [line.split()[0] for line in lines if line.endswith(" of 4")]
    assert places == ["ssim-object", "lpips"]
    titles = [line for line in lines if " against " in line and "scored" not in line]
    assert titles[1:] == [
        f"my_method:METHOD against {baseline} on 2 objects (chair), paired"
        for baseline in ("splat-net", "best-classical")
    ]
    assert "the best there by ssim-object and lpips: splat-net" in lines
    # Two objects decide nothing, which the verdict has to say.
    assert sum(" decide nothing here" in line for line in lines) == 2
    assert lines[-1] == "report: ../base/report.html"
    records = pd.read_parquet("../base/records.parquet")
    drawn = records[records["method"] == "my_method:METHOD"]
    assert (drawn["outcome"] == "ok").all()
    assert len(drawn) == 4
    assert "my_method:METHOD" in Path("../base/report.html").read_text()


def test_the_commands_for_agents_run(tmp_path, monkeypatch):
    """The run and the method are those of the page, where the same commands stand."""
    text = AGENTS.read_text(encoding="utf-8")
    lines = lines_of(AGENTS)
    walked = lines_of(EXTENDING, "From nothing to a verdict")
    assert [line for line in lines if line in walked] == walked
    monkeypatch.chdir(tmp_path)
    Path("examples").mkdir()
    shutil.copy(REPOSITORY / "examples" / "chair.ply", "examples")
    printed = walk([line for line in lines if line not in walked[1:]], monkeypatch)
    assert list(printed) == ["run", "table", "compare", "report", "render"]
    assert printed["report"] == "base/report.html\n"
    for name in ("tables", "records.parquet", "report.html", "manifest.json", "run.sqlite"):
        assert f"base/{name}" in text
        assert Path("base", name).exists()
