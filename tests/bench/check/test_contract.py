"""The output and the verdicts of `bench test`, plug-ins by name, and the time limit of a test."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from bench.catalogue.suites import Limits
from bench.check.contract.findings import Finding, is_blocked, summary
from bench.check.contract.plugin import plugin_findings
from bench.check.contract.targets import check_name
from data_prep.failures import BadInput

REPOSITORY = Path(__file__).parents[3]
MODULE = "tests.bench.check.broken_methods"


def findings(verdicts):
    """A finding for each letter: o(k), w(arn), F(AIL)."""
    return [Finding(v == "o", f"point {i}", "", v == "F") for i, v in enumerate(verdicts)]


@pytest.mark.parametrize(
    ("verdicts", "line"),
    [
        ("ooo", "0 block a run, 0 warnings"),
        ("oFo", "1 blocks a run (point 1), 0 warnings"),
        ("FwF", "2 block a run (point 0, point 2), 1 warning (point 1)"),
        ("wwF", "1 blocks a run (point 2), 2 warnings (point 0, point 1)"),
        ("owo", "0 block a run, 1 warning (point 1)"),
    ],
)
def test_the_summary_tells_what_blocks_a_run(verdicts, line):
    assert summary(findings(verdicts)) == line
    assert summary(findings(verdicts), "bench list") == f"{line}; next: bench list"
    assert is_blocked(findings(verdicts)) == ("F" in verdicts)


@pytest.mark.parametrize("name", ["splat", f"{MODULE}:Plain", "procedural:validation"])
def test_known_names_are_not_loaded_by_the_command(name):
    check_name(name)
    with pytest.raises(BadInput):
        check_name(name[1:])


def bench(*arguments, cwd):
    """The command line in a folder."""
    return subprocess.run(
        (sys.executable, "-P", "-c", "from bench.cli import main; main()", *arguments),
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"PYTHONPATH": str(REPOSITORY)},
        cwd=cwd,
    )


def test_a_class_of_the_current_folder(tmp_path):
    """A class without an entry point is tested, and other files of the folder hide no module."""
    (tmp_path / "mine.py").write_text(f"from {MODULE} import Plain as Mine\n")
    (tmp_path / "random.py").write_text("raise SystemExit('of the folder')\n")
    done = bench("test", "mine:Mine", cwd=tmp_path)
    *lines, last = done.stdout.splitlines()
    assert (done.returncode, done.stderr) == (0, "")
    assert last == "0 block a run, 0 warnings; next: bench add mine:Mine DIR"
    assert [line for line in lines if not line.startswith("ok   ")] == []


def test_a_machine_on_which_no_worker_begins_is_a_finding():
    (finding,) = plugin_findings(f"{MODULE}:Plain", Limits(60.0, 4.0), clock_s=3.0)
    said = "all of it: 3 s are over; test it again when the machine is less busy"
    assert finding == Finding(False, "not tested", said, blocks=False)


def test_what_there_is_no_processor_time_for_is_a_warning():
    *_, last = plugin_findings(f"{MODULE}:Plain", total_s=0.0)
    assert (last.subject, last.verdict) == ("not tested", "warn")
    assert last.text.endswith(": 0 s of processor time are over")


@pytest.mark.slow
def test_the_time_of_a_whole_test_is_limited(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # of a package in the current folder all sources are read
    start = time.monotonic()
    texts = {
        finding.subject: finding.text
        for finding in plugin_findings(
            f"{MODULE}:HANGS_WITHOUT_POINTS", Limits(60.0, 4.0), clock_s=20.0
        )
    }
    assert time.monotonic() - start < 20.0
    assert texts["calls"].startswith("8 others between change nothing")
    assert texts["not tested"].startswith("no points, one point, three points, ")
    assert "a point at infinity: 20 s are over; test it again" in texts["not tested"]
