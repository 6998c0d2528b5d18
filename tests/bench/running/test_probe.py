from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

from bench.running import environment as probe
from bench.running.environment import environment
from bench.running.pool import WORKER_ENVIRONMENT
from data_prep.failures import MissingDependency
from data_prep.rendering import opengl as render


def process(stdout, code=0):
    """Return a stand-in for `subprocess.run` (without output it hangs), and its calls."""
    calls = []

    def run(command, **options):
        calls.append((command, options))
        if stdout is None:
            raise subprocess.TimeoutExpired(command, options["timeout"])
        return subprocess.CompletedProcess(command, code, stdout, "noise")

    return run, calls


def test_the_last_line_is_the_answer():
    run, calls = process('a driver says hello\n{"gl": "llvmpipe"}\n')
    assert environment(run) == {"gl": "llvmpipe"} | render.scene_values()
    ((command, options),) = calls
    assert command == [sys.executable, "-P", "-m", "bench.running.environment"]
    assert WORKER_ENVIRONMENT.items() <= options["env"].items()
    assert options["env"]["PATH"] == os.environ["PATH"]


CRASHED = f"OpenGL ended its process (exit code -11): {render.REMEDY}"
SILENT = f"OpenGL did not answer in 120 s: {render.REMEDY}"


@pytest.mark.parametrize(
    ("stdout", "code", "message"),
    [
        ("", -11, CRASHED),
        ("no json\n", -11, CRASHED),
        (None, 0, SILENT),
        ('{"error": "no OpenGL: install libegl1"}', 0, "no OpenGL: install libegl1"),
    ],
)
def test_a_driver_that_crashes_hangs_or_refuses(stdout, code, message):
    with pytest.raises(MissingDependency) as error:
        environment(process(stdout, code)[0])
    assert str(error.value) == message


def test_what_the_other_process_prints(capsys):
    probe.main(lambda: "a driver")
    printed = json.loads(capsys.readouterr().out)
    assert printed.keys() == {"gl", "render", "pyrender", "numpy"}
    assert (printed["gl"], printed["render"]) == ("a driver", str(render.VERSION))

    def refusing():
        raise MissingDependency("none here")

    probe.main(refusing)
    assert json.loads(capsys.readouterr().out) == {"error": "none here"}
