from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

from bench.running import environment as probe
from bench.running.environment import environment
from bench.running.isolation import WORKER_ENVIRONMENT
from data_prep import render
from data_prep.failures import MissingDependency


def answer(monkeypatch, stdout="", code=0):
    """What the other process says."""
    calls = []

    def run(command, **options):
        calls.append((command, options))
        return subprocess.CompletedProcess(command, code, stdout, "noise")

    monkeypatch.setattr(subprocess, "run", run)
    return calls


def test_the_last_line_is_the_answer(monkeypatch):
    calls = answer(monkeypatch, 'a driver says hello\n{"gl": "llvmpipe"}\n')
    assert environment() == {"gl": "llvmpipe"}
    ((command, options),) = calls
    assert command == [sys.executable, "-m", "bench.running.environment"]
    assert WORKER_ENVIRONMENT.items() <= options["env"].items()
    assert options["env"]["PATH"] == os.environ["PATH"]


@pytest.mark.parametrize("stdout", ["", "no json\n"])
def test_a_driver_that_crashes(monkeypatch, stdout):
    answer(monkeypatch, stdout, code=-11)
    with pytest.raises(MissingDependency) as error:
        environment()
    assert str(error.value) == f"OpenGL ended its process (exit code -11): {render.REMEDY}"


def test_a_driver_that_hangs(monkeypatch):
    def run(command, timeout, **options):
        raise subprocess.TimeoutExpired(command, timeout)

    monkeypatch.setattr(subprocess, "run", run)
    with pytest.raises(MissingDependency, match="OpenGL did not answer in 120 s: install the "):
        environment()


def test_a_reason_is_passed_on(monkeypatch):
    answer(monkeypatch, '{"error": "no OpenGL context: install libegl1"}')
    with pytest.raises(MissingDependency, match=r"^no OpenGL context: install libegl1$"):
        environment()


def test_what_the_other_process_prints(monkeypatch, capsys):
    monkeypatch.setattr(render, "gl_renderer", lambda: "a driver")
    probe.main()
    found = json.loads(capsys.readouterr().out)
    assert found["gl"] == "a driver"
    assert found["render"] == str(render.VERSION)
    assert {"gl", "render", "pyrender", "numpy"} <= found.keys()

    def gl_renderer():
        raise MissingDependency("none here")

    monkeypatch.setattr(render, "gl_renderer", gl_renderer)
    probe.main()
    assert json.loads(capsys.readouterr().out) == {"error": "none here"}
