from __future__ import annotations

import ctypes
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import pytest

import bench.commands.doctor
from bench.catalogue.methods import METHODS, Method
from bench.commands.doctor import examine
from bench.running.environment import PACKAGES
from data_prep.failures import BadInput, MissingDependency
from data_prep.render import DEBIAN_PACKAGES


@pytest.fixture(autouse=True)
def healthy(monkeypatch):
    """A machine where all is well."""
    monkeypatch.setattr(bench.commands.doctor, "environment", lambda: {"gl": "a driver"})
    monkeypatch.setattr(ctypes, "CDLL", lambda name: None)
    methods = [m for m in METHODS if m.id != "pc2pix"]
    monkeypatch.setattr(bench.commands.doctor, "METHODS", methods)


def found():
    return {finding.subject: (finding.ok, finding.text) for finding in examine()}


def test_a_healthy_machine(command):
    findings = found()
    assert all(ok for ok, _ in findings.values())
    for package in PACKAGES:
        assert findings[package] == (True, version(package))
    assert findings["libEGL.so.1"] == (True, "found")
    assert findings["rendering"] == (True, "a driver")
    assert findings["method blank"] == (True, "ready")
    assert findings["method splat"] == (True, f"scipy {version('scipy')}")
    text = findings["metric fd-views"][1]
    assert Path(text).name == "views_network.safetensors"
    assert "cores" in findings["machine"][1]
    status, out, err = command("doctor")
    assert (status, err) == (0, "")
    assert out.splitlines() == [
        f"ok   {subject}: {text}" for subject, (_, text) in findings.items()
    ]


def test_missing_fid_weights_are_no_fault(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    ok, text = found()["metric fid"]
    assert ok
    assert text.startswith("skipped in runs: the FID weights are not in the cache; give ")


def break_library(monkeypatch, broken):
    def load(name):
        if name == broken:
            raise OSError(f"{name}: cannot open shared object file")

    monkeypatch.setattr(ctypes, "CDLL", load)


@pytest.mark.parametrize(
    ("library", "ok", "text"),
    [
        ("libEGL.so.1", False, "missing (needed): apt-get install libegl1"),
        ("libOpenGL.so.0", False, "missing (needed): apt-get install libopengl0"),
        ("libusb-1.0.so.0", True, "missing (optional, for Open3D): apt-get install libusb-1.0-0"),
    ],
)
def test_a_missing_library(monkeypatch, command, library, ok, text):
    break_library(monkeypatch, library)
    assert found()[library] == (ok, text)
    status, out, _ = command("doctor")
    assert status == (0 if ok else 1)
    assert f"{'ok  ' if ok else 'FAIL'} {library}: {text}\n" in out


def test_a_missing_package(monkeypatch, command):
    def find(package):
        if package == "pyrender":
            raise PackageNotFoundError(package)
        return "1.0"

    monkeypatch.setattr(bench.commands.doctor, "version", find)
    assert found()["pyrender"] == (False, "not installed: run 'make install'")
    assert command("doctor")[0] == 1


def test_no_opengl(monkeypatch, command):
    def environment():
        raise MissingDependency("no OpenGL context: install libegl1")

    monkeypatch.setattr(bench.commands.doctor, "environment", environment)
    status, out, err = command("doctor")
    assert (status, err) == (1, "")
    assert "FAIL rendering: no OpenGL context: install libegl1\n" in out


def test_a_method_without_its_weights(monkeypatch):
    def identity():
        raise BadInput("chair.safetensors: missing; reinstall")

    broken = Method("broken", load=lambda device: None, identity=identity, version=1, source="")
    monkeypatch.setattr(bench.commands.doctor, "METHODS", [broken])
    assert found()["method broken"] == (False, "chair.safetensors: missing; reinstall")


def test_set_up_installs_what_the_doctor_looks_for():
    script = (Path(__file__).parents[3] / ".ci" / "libraries").read_text(encoding="utf-8")
    listed = dict(
        pair.split("=") for pair in script.split('wanted="')[1].split('"')[0].split() if "=" in pair
    )
    assert {debian: library for library, debian in listed.items()} == DEBIAN_PACKAGES
