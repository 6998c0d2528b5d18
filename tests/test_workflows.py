"""The workflows of GitHub: their commands are targets of the Makefile, and they may only read."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / ".github" / "workflows"
CPU = "https://download.pytorch.org/whl/cpu"


def read(name: str) -> dict[Any, Any]:
    return yaml.safe_load((FOLDER / name).read_text("utf-8"))


def steps(workflow: dict[Any, Any]) -> list[dict[str, Any]]:
    return [step for job in workflow["jobs"].values() for step in job["steps"]]


def commands(workflow: dict[Any, Any]) -> list[list[str]]:
    return [shlex.split(step["run"]) for step in steps(workflow) if "run" in step]


def dry_run(command: list[str]) -> str:
    """Return what a make command would do."""
    assert command[0] == "make"
    arguments = ("make", "--dry-run", "--always-make", *command[1:])
    return subprocess.run(arguments, cwd=ROOT, capture_output=True, text=True, check=True).stdout


@pytest.mark.parametrize("name", ["pages.yml", "tests.yml"])
def test_a_workflow_is_of_one_kind_with_the_others(name):
    workflow = read(name)
    assert workflow["name"] == Path(name).stem
    assert workflow["permissions"] == {"contents": "read"}
    assert workflow["concurrency"]["cancel-in-progress"] is True
    assert {job["runs-on"] for job in workflow["jobs"].values()} == {"ubuntu-24.04"}
    for step in steps(workflow):
        assert ("uses" in step) != ("run" in step)
        if step.get("uses", "").startswith("actions/setup-python@"):
            assert (ROOT / step["with"]["cache-dependency-path"]).is_file()


def test_the_commands_are_targets_of_the_makefile():
    phony = re.search(r"^\.PHONY: (.+)$", (ROOT / "Makefile").read_text(), re.MULTILINE)
    assert phony is not None
    for name in ("pages.yml", "tests.yml"):
        (command,) = commands(read(name))
        assert command[1] in phony[1].split()
        assert dry_run(command)
    with pytest.raises(subprocess.CalledProcessError):
        dry_run(["make", "no-such-target"])


def test_the_tests_run_on_pushes_and_pull_requests_with_torch_for_the_cpu():
    workflow = read("tests.yml")
    # YAML 1.1 reads the key "on" as true.
    assert workflow[True] == {"push": {"branches": ["main"]}, "pull_request": None}
    (job,) = workflow["jobs"].values()
    assert job["env"] == {"PIP_EXTRA_INDEX_URL": CPU}
    versions = job["strategy"]["matrix"]["python"]
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    assert project["requires-python"] == f">={versions[0]}"
    assert "tox run" in dry_run(*commands(workflow))


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


def test_the_pages_that_are_published_are_those_that_are_built():
    workflow = read("pages.yml")
    (command,) = commands(workflow)
    assert f"--extra-index-url {CPU}" in command[2]
    (upload,) = [s for s in steps(workflow) if "upload-pages" in s.get("uses", "")]
    assert f"sphinx-build -b html docs {upload['with']['path']}" in dry_run(command)
