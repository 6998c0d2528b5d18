"""The workflow and the job of docs/in-ci.md: their `bench` commands, on two meshes."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml
from typer.testing import CliRunner

from bench.cli import app
from data_prep.datasets.registry import open_dataset
from data_prep.rendering.opengl import DEBIAN_PACKAGES

PAGE = (Path(__file__).parents[1] / "docs" / "in-ci.md").read_text(encoding="utf-8")


@pytest.mark.slow
def test_the_golden_values_of_the_page_are_kept_by_both_jobs(tmp_path, monkeypatch):
    first, github, gitlab = re.findall(r"^```\w*\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
    steps = [
        step["run"] for step in yaml.safe_load(github)["jobs"]["bench"]["steps"] if "run" in step
    ]
    job = yaml.safe_load(gitlab)["bench"]
    for lines in (steps, job["before_script"]):
        assert lines[0].endswith(f"install -qq -y {' '.join(DEBIAN_PACKAGES)}")
    monkeypatch.chdir(tmp_path)
    Path("meshes").mkdir()
    for i, chair in enumerate(open_dataset("procedural").objects("chair", 2, 2)):
        mesh = chair.load()
        corners = "".join("v {} {} {}\n".format(*vertex) for vertex in mesh.vertices)
        faces = "".join("f {} {} {}\n".format(*face) for face in mesh.faces + 1)
        Path(f"meshes/{i}.obj").write_text(corners + faces)
    for commands in (first.splitlines(), steps, job["script"]):
        for line in commands:
            if line.startswith("bench "):
                command, _, printed = line.partition(" > ")
                done = CliRunner().invoke(app, shlex.split(command)[1:])
                assert done.exit_code == 0, done.output
                Path(printed or "printed").write_text(done.stdout)
        if Path("check.xml").exists():
            assert ElementTree.parse("check.xml").getroot().get("failures") == "0"
            Path("check.xml").rename("checked.xml")
