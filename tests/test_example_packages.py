"""The packages in examples/, which docs/extending.md explains: installed and found by commands."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest
import trimesh

pytestmark = pytest.mark.slow

REPOSITORY = Path(__file__).parent.parent
EXAMPLES = REPOSITORY / "examples"
NAMES = ("method", "metric", "extractor", "dataset", "condition")


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """The command line where all of them are installed."""
    folder = tmp_path_factory.mktemp("packages")
    # Copied: a build leaves files beside its source.
    sources = [shutil.copytree(EXAMPLES / name, folder / name) for name in NAMES]
    pip = (sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check")
    offline = ("--no-index", "--no-deps", "--no-build-isolation")
    subprocess.run([*pip, *offline, "--target", folder / "site", *sources], check=True)
    paths = os.pathsep.join((str(folder / "site"), str(REPOSITORY)))

    def run(*arguments):
        command = (sys.executable, "-c", "from bench.cli import main; main()", *map(str, arguments))
        environment = os.environ | {"PYTHONPATH": paths, "XDG_CACHE_HOME": str(folder)}
        return subprocess.run(
            command, capture_output=True, text=True, check=False, env=environment, cwd=folder
        )

    return run


@pytest.fixture(scope="module")
def meshes(tmp_path_factory):
    """A folder of two boxes of other proportions, and the list that the dataset reads."""
    folder = tmp_path_factory.mktemp("boxes")
    for name, tall in (("a", 1.0), ("b", 2.0)):
        trimesh.creation.box((1, 1, tall)).export(folder / f"{name}.ply")
    (folder / "objects.csv").write_text("test,chair,a.ply\ntest,chair,b.ply\n")
    return folder


def test_method_dataset_and_condition_make_a_run_that_the_metric_scores(bench, meshes, tmp_path):
    """The run has the ceiling and the floor, too."""
    out = tmp_path / "run"
    chosen = ("--methods", "convex-hull,true-mesh", "--conditions", "2048,dropout-half")
    small = ("--views", "2", "--workers", "2", "--out", out)
    dataset = ("--dataset", f"mesh-list:{meshes}")
    done = bench("run", "--suite", "chair-robustness", *dataset, *chosen, *small)
    assert done.returncode == 0, done.stderr
    records = pd.read_parquet(out / "records.parquet")
    assert set(records["object"]) == {"a.ply", "b.ply"}
    assert set(records["outcome"]) == {"ok"}
    value = records.groupby(["method", "condition"])["ssim"].mean()
    # The hull of a box is the box, but for its grey; half of the points make it smaller.
    assert 0 < value["convex-hull", "dropout-half"] < value["convex-hull", "2048"] < 1
    assert "loses half of its points" in (out / "report.html").read_text()
    done = bench("score", out, "--metrics", "pixel-error,fd-edges")
    assert (done.returncode, done.stderr) == (0, "")
    for metric in ("pixel-error", "fd-edges"):
        rows = pd.read_csv(out / "tables" / f"metric_{metric}.csv")
        value = rows[rows["metric"] == metric].set_index(["method", "condition"])["value"]
        assert value["true-mesh", "2048"] == pytest.approx(0, abs=1e-12)
        assert 0 < value["convex-hull", "2048"] < value["blank", "2048"]


@pytest.mark.parametrize(
    ("name", "ending"),
    [
        ("convex-hull", "add convex-hull DIR"),
        ("pixel-error", "--metrics pixel-error"),
        ("fd-edges", "--metrics fd-edges"),
        ("dropout-half", "--conditions dropout-half"),
        ("mesh-list:MESHES", "--suite thirteen-classes --dataset mesh-list:MESHES"),
    ],
)
def test_the_examples_keep_their_contracts(bench, meshes, name, ending):
    done = bench("test", name.replace("MESHES", str(meshes)))
    *lines, last = done.stdout.splitlines()
    assert [line for line in lines if not line.startswith("ok   ")] == []
    assert last.startswith("0 block a run, 0 warnings; next: bench ")
    assert last.endswith(ending.replace("MESHES", str(meshes)))
    assert (done.returncode, done.stderr) == (0, "")


def test_their_own_tests_pass():
    tests = [*EXAMPLES.glob("*/test_*.py")]
    assert len(tests) == 3
    options = ("-q", "-p", "no:cacheprovider", "--import-mode=prepend")
    command = (sys.executable, "-m", "pytest", *options, *map(str, tests))
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
