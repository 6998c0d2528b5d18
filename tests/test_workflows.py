"""The workflows of GitHub: their commands are targets of the Makefile, and they may only read."""

from __future__ import annotations

import shlex
import shutil
import subprocess
from pathlib import Path

import yaml

ROOT = Path(__file__).parents[1]


def commands(name: str) -> list[list[str]]:
    workflow = yaml.safe_load((ROOT / ".github" / "workflows" / name).read_text("utf-8"))
    assert workflow["permissions"] == {"contents": "read"}
    steps = (step for job in workflow["jobs"].values() for step in job["steps"])
    return [shlex.split(step["run"]) for step in steps if "run" in step]


def dry_run(command: list[str]) -> str:
    """Return what a make command would do."""
    assert command[0] == "make"
    arguments = ("make", "--dry-run", "--always-make", *command[1:])
    return subprocess.run(arguments, cwd=ROOT, capture_output=True, text=True, check=True).stdout


def test_the_commands_are_targets_of_the_makefile():
    for name, does in (("pages.yml", "sphinx-build -b html docs "), ("tests.yml", "tox run")):
        (command,) = commands(name)
        assert does in dry_run(command)


def test_a_package_that_ubuntu_lacks_does_not_keep_the_others_from_being_installed(tmp_path):
    scripts = {
        "apt-get": 'echo "apt-get $*"',
        "apt-cache": '[ "$2" != chromium ]',
        "ldconfig": "echo libGL.so.1",
        "python3": "exit 0",
        "id": "echo 0",
    }
    for name, script in scripts.items():
        (tmp_path / name).write_text(f"#!/bin/sh\n{script}\n")
        (tmp_path / name).chmod(0o755)
    for name in ("sh", "env"):
        (tmp_path / name).symlink_to(str(shutil.which(name)))
    done = subprocess.run(
        ("sh", ".ci/libraries", "tests"),
        cwd=ROOT,
        env={"PATH": str(tmp_path)},
        capture_output=True,
        text=True,
        check=True,
    )
    *_, installed, missing = done.stderr.splitlines()
    packages = "libegl1 libopengl0 libgomp1 libusb-1.0-0"
    assert installed == f"apt-get install -qq -y --no-install-recommends {packages}"
    assert missing == "missing libraries; as root: apt-get install chromium"
