"""A current folder with modules of the names that Python and the project use: none is run."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib.util import find_spec

import pytest

from bench.catalogue.suites import Limits
from bench.running.environment import environment
from bench.running.pool import run_tasks

RUN = (
    *("run", "--suite", "chair-robustness", "--limit", "1", "--methods", "splat,blank"),
    *("--conditions", "2048", "--views", "2", "--workers", "1", "--out", "run"),
)
MODULES = ("random", "struct", "bench", "numpy")


@pytest.fixture
def folder(tmp_path):
    """The folder; each of its modules leaves a file beside it and fails."""
    folder = tmp_path / "foreign"
    folder.mkdir()
    for name in MODULES:
        text = f"open({str(tmp_path / name)!r}, 'w').close(); raise RuntimeError('foreign')"
        (folder / f"{name}.py").write_text(text)
    yield folder
    assert [path.name for path in tmp_path.iterdir() if path.name in MODULES] == []


def flags(_) -> tuple[bool, str | None]:
    return bool(sys.flags.safe_path), os.environ.get("PYTHONSAFEPATH")


@pytest.mark.opengl
def test_processes_of_the_project_run_no_module_of_it(folder, monkeypatch):
    monkeypatch.chdir(folder)
    assert environment()["gl"]
    # A method that starts Python gets it as usual.
    assert list(run_tasks([0], flags, 1, Limits(60.0, 8.0))) == [(0, (True, None))]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (("doctor", "-v"), "ok   rendering: "),
        (("test", "splat"), "ok   another process: "),
        (RUN, "3 jobs done, 0 from before, 0 failed"),
        pytest.param(
            (*RUN, "--ray", "local"),
            "3 jobs done, 0 from before, 0 failed",
            marks=[pytest.mark.ray, pytest.mark.skipif(not find_spec("ray"), reason="needs [ray]")],
        ),
    ],
)
def test_commands_run_no_module_of_it(folder, tmp_path, arguments, line):
    start = [sys.executable, "-P", "-c", "from bench.cli import main; main()"]
    done = subprocess.run(
        [*start, *arguments], cwd=folder, capture_output=True, text=True, check=False,
        env=os.environ | {"XDG_CACHE_HOME": str(tmp_path)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert line in done.stdout + done.stderr
