"""The output and the verdicts of `bench test`, plug-ins by name, and the time limit of a test."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from bench.catalogue.suites import Limits
from bench.checking.contract.findings import Finding, is_blocked, summary
from bench.checking.contract.plugin import plugin_findings
from bench.checking.contract.session import CheckStep, Passed, Report, trace_findings
from bench.checking.contract.targets import check_name
from bench.checking.contract.traces import (
    ProcessState,
    await_processes,
    captured_output,
    end_processes,
    traces,
)
from data_prep.failures import BadInput

REPOSITORY = Path(__file__).parents[3]
MODULE = "tests.bench.checking.broken_methods"


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


def reports(*traced, in_command=False):
    """Reports of steps 0, 1, ... with these traces."""
    steps = [
        CheckStep(f"step {i}", lambda name: Passed(""), in_command) for i in range(len(traced))
    ]
    return [
        Report(step, Finding(True, step.subject, ""), None, left)
        for step, left in zip(steps, traced, strict=True)
    ]


def test_traces_of_all_steps_are_told_once():
    by_subject = {
        finding.subject: finding
        for finding in trace_findings(reports({}, {"files left": "1 (a)"}, {"files left": "2 (b)"}))
    }
    assert by_subject["files left"] == Finding(
        False, "files left", "step 1: 1 (a); 2 steps in all", False
    )
    assert [by_subject[kind].ok for kind in ("stdout", "threads left", "processes left")] == [
        True
    ] * 3


@pytest.mark.parametrize(
    ("kind", "in_command", "verdict"),
    [
        ("stdout", False, "warn"),
        ("stdout", True, "FAIL"),  # commands print their results there
        ("stderr", True, "warn"),
        ("files left", True, "warn"),
        ("threads left", True, "warn"),
        ("processes left", False, "FAIL"),
        ("working folder", False, "FAIL"),
    ],
)
def test_which_traces_block_a_run(kind, in_command, verdict):
    found = trace_findings(reports({kind: "1 (a)"}, in_command=in_command))
    assert {finding.subject: finding.verdict for finding in found if not finding.ok} == {
        kind: verdict
    }


def test_what_code_leaves_behind_is_observed(tmp_path, monkeypatch):
    folder, temporary = tmp_path / "work", tmp_path / "temporary"
    (folder / "old").mkdir(parents=True)
    temporary.mkdir()
    monkeypatch.chdir(folder)
    before = ProcessState.take(temporary)
    assert traces(before, ProcessState.take(temporary)) == {}
    (folder / "old" / "new.txt").touch()
    (temporary / "left.ply").touch()
    (folder / ".hidden").touch()
    goes_on = threading.Event()
    thread = threading.Thread(target=goes_on.wait, name="watcher")
    thread.start()
    process = subprocess.Popen(["sleep", "60"])
    left = traces(before, ProcessState.take(temporary))
    assert left == {
        "files left": f"2 ({temporary / 'left.ply'}, old)",
        "threads left": "1 (watcher)",
        "processes left": "1 (sleep)",
    }
    monkeypatch.chdir(temporary)
    assert (
        traces(before, ProcessState.take(temporary))["working folder"] == f"changed to {temporary}"
    )
    goes_on.set()
    thread.join()
    end_processes()
    await_processes()
    assert process.wait() == -9


def test_output_of_all_code_is_captured(capfd):
    with captured_output() as output:
        os.write(1, b"from Python\n")
        os.write(2, b"from a library\nand more")
        subprocess.run([sys.executable, "-S", "-c", "print('from a process')"], check=True)
    os.write(1, b"afterwards\n")
    assert output == {
        "stdout": "27 bytes: 'from Python'",
        "stderr": "23 bytes: 'from a library'",
    }
    assert capfd.readouterr() == ("afterwards\n", "")


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
    (tmp_path / "mine.py").write_text(f"from {MODULE} import Prints as Mine\n")
    (tmp_path / "random.py").write_text("raise SystemExit('of the folder')\n")
    done = bench("test", "mine:Mine", cwd=tmp_path)
    *lines, last = done.stdout.splitlines()
    assert (done.returncode, done.stderr) == (0, "")
    assert last == "0 block a run, 1 warning (stdout); next: bench add mine:Mine DIR"
    (printed,) = (line for line in lines if not line.startswith("ok   "))
    assert printed.startswith("warn stdout: first use: 26 bytes: 'points: 2048'; ")


@pytest.mark.slow
def test_what_exits_does_not_pass(tmp_path):
    done = bench("test", f"{MODULE}:EXITS", cwd=tmp_path)
    assert done.returncode == 1
    assert "FAIL images: SystemExit(0): raise an exception, do not end the process" in done.stdout
    last = done.stdout.splitlines()[-1]
    assert " block a run (images, " in last
    assert last.endswith(f"; next: mend what FAIL says, then bench test {MODULE}:EXITS")


def test_a_machine_on_which_no_worker_begins_is_a_finding():
    (finding,) = plugin_findings(f"{MODULE}:Plain", Limits(60.0, 4.0), 3.0)
    assert finding == Finding(False, "not tested", "all of it: 3 s are over")


@pytest.mark.slow
def test_the_time_of_a_whole_test_is_limited():
    start = time.monotonic()
    texts = {
        finding.subject: finding.text
        for finding in plugin_findings(f"{MODULE}:HANGS_WITHOUT_POINTS", Limits(60.0, 4.0), 8.0)
    }
    assert time.monotonic() - start < 8.0
    assert texts["clouds"].startswith("8 others between change nothing")
    assert texts["not tested"].startswith("no points, one point, three points, ")
    assert texts["not tested"].endswith("a point at infinity: 8 s are over")
