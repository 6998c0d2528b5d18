"""Pages whose commands and blocks are run: CI, Python, the Dockerfile."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml
from PIL import Image
from typer.testing import CliRunner

import bench
from bench.cli import app
from bench.metrics import ssim
from data_prep.datasets.registry import open_dataset
from data_prep.rendering.opengl import DEBIAN_PACKAGES

ROOT = Path(__file__).parents[1]
BLOCK = re.compile(r"^```(\w*)\n(.*?)^```", re.MULTILINE | re.DOTALL)


def blocks(page, language):
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    return [block for kind, block in BLOCK.findall(text) if kind == language]


def execute(lines):
    """Run the lines that are `bench` commands, and write what they print where they say."""
    for line in lines:
        if line.startswith("bench "):
            command, _, printed = line.partition(" > ")
            done = CliRunner().invoke(app, shlex.split(command)[1:])
            assert done.exit_code == 0, done.output
            Path(printed or "printed").write_text(done.stdout)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with a cloud, two meshes, and the run and the golden values of docs/in-ci.md."""
    folder = tmp_path_factory.mktemp("ci")
    (folder / "meshes").mkdir()
    shutil.copy(ROOT / "examples" / "chair.ply", folder / "cloud.ply")
    for i, chair in enumerate(open_dataset("procedural").objects("chair", 2, 2)):
        mesh = chair.load()
        corners = "".join("v {} {} {}\n".format(*vertex) for vertex in mesh.vertices)
        faces = "".join("f {} {} {}\n".format(*face) for face in mesh.faces + 1)
        (folder / "meshes" / f"{i}.obj").write_text(corners + faces)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        execute(blocks("in-ci.md", "")[0].splitlines())
    return folder


@pytest.mark.slow
def test_the_golden_values_of_the_page_are_kept_by_both_jobs(folder, monkeypatch):
    monkeypatch.chdir(folder)
    github, gitlab = map(yaml.safe_load, blocks("in-ci.md", "yaml"))
    steps = [step["run"] for step in github["jobs"]["bench"]["steps"] if "run" in step]
    for before, lines in (
        (steps, steps),
        (gitlab["bench"]["before_script"], gitlab["bench"]["script"]),
    ):
        assert before[0].endswith(f"install -qq -y {' '.join(DEBIAN_PACKAGES)}")
        execute(lines)
        assert ElementTree.parse("check.xml").getroot().get("failures") == "0"
        Path("check.xml").unlink()


@pytest.mark.slow
def test_the_script_of_the_page_on_python(folder):
    parts = blocks("python.md", "python")
    assert len(parts) == 8
    done = subprocess.run(
        [sys.executable, "-c", "\n".join(parts)], cwd=folder, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    maps, like_blank, pairs = done.stdout.splitlines()
    assert maps.startswith("(128, 128) 1.0 [")
    expected = bench.draw_cloud(folder / "cloud.ply", 30, 20)
    assert float(like_blank) == pytest.approx(ssim(expected, 255 + 0 * expected).ssim, abs=1e-4)
    assert pairs == "(36,)"
    assert '"points": "' in (folder / "cloud.html").read_text()
    with Image.open(folder / "chair.png") as image:
        # Another process may have another number of threads: a grey level by rounding.
        np.testing.assert_allclose(np.asarray(image).astype(int), expected, rtol=0, atol=1)
    with Image.open(folder / "turn.gif") as turn:
        assert (turn.n_frames, turn.size) == (36, (128, 128))
    with Image.open(folder / "surface.png") as surface:
        assert (np.asarray(surface) < 255).any()


def test_the_dockerfile_installs_the_libraries_that_rendering_needs():
    text = (ROOT / "Dockerfile").read_text()
    (listed,) = re.findall(r"--no-install-recommends \\\n\s+(.*?) \\\n", text)
    assert listed.split() == [*DEBIAN_PACKAGES]
    left_out = (ROOT / ".dockerignore").read_text().split()
    assert not {"bench", "results", "constraints.txt", "README.md"} & {*left_out}


@pytest.mark.slow
def test_the_image_draws_a_cloud(folder):
    if not shutil.which("docker") or subprocess.run(["docker", "info"], check=False).returncode:
        pytest.skip("no docker that runs here")
    subprocess.run(["docker", "build", "-t", "pc2pix-bench-test", ROOT], check=True)
    draw = ("render", "cloud.ply", "--method", "surface-fit", "-o", "drawn.png")
    docker = ("docker", "run", "--rm", "-v", f"{folder}:/work", "pc2pix-bench-test")
    subprocess.run([*docker, *draw], check=True)
    assert (np.asarray(Image.open(folder / "drawn.png")) < 255).any()
