"""The wheel alone, without the checkout: unpacked, run from an empty folder, its run checked."""

from __future__ import annotations

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
DATA = {
    *(".csv", ".json", ".png", ".safetensors", ".md", ".txt", ".cff"),
    *(".css", ".jinja", ".js", ".vert", ".frag"),
}
NOT_INSTALLED = ("docs", "results/docs", "tests", "studies", "examples")
FOR_READERS = {"results/claims.md"}
MAIN = "import sys; from bench.cli import main; main()"


@pytest.fixture(scope="module")
def installed(tmp_path_factory) -> Path:
    """The files of the wheel; what it requires is in this environment."""
    folder = tmp_path_factory.mktemp("wheel")
    command = ("-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation")
    source = folder / "source"  # setuptools builds inside
    tracked = subprocess.check_output(("git", "ls-files", "-z"), cwd=ROOT, text=True)
    for name in filter(None, tracked.split("\0")):
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        (source / name).symlink_to(ROOT / name)
    subprocess.run((sys.executable, *command, "-w", str(folder), str(source)), check=True)
    (wheel,) = folder.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder / "installed")
    return folder / "installed"


@pytest.mark.slow
def test_it_has_all_data_of_the_packages(installed):
    there = {path.relative_to(installed).as_posix() for path in installed.rglob("*")}
    tracked = subprocess.check_output(("git", "ls-files"), cwd=ROOT, text=True).split()
    wanted = {
        name
        for name in tracked
        if Path(name).suffix in DATA and "/" in name and not name.startswith(NOT_INSTALLED)
    }
    assert wanted - there == FOR_READERS


@pytest.mark.slow
def test_a_run_from_an_empty_folder_agrees_with_the_golden_values(installed, tmp_path):
    environment = os.environ | {"PYTHONPATH": str(installed)}

    def bench(*arguments: str) -> str:
        code = f"{MAIN}" if arguments else "import bench; print(bench.__file__)"
        command = (sys.executable, "-c", code, *arguments)
        return subprocess.check_output(command, cwd=tmp_path, env=environment, text=True)

    assert Path(bench().strip()).is_relative_to(installed)
    run = ("run", "--suite", "chair-robustness", "--limit", "1", "--methods", "splat,blank")
    bench(*run, "--conditions", "2048", "--workers", "1")
    (found,) = tmp_path.glob("results/runs/*")
    checked = bench("check", str(found))
    assert checked.splitlines()[-1].endswith(" golden values compared, 0 moved")
    assert not checked.endswith("\n0 golden values compared, 0 moved\n")
