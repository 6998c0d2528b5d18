"""The packages in examples/, which docs/extending.md explains: installed and found by commands."""

from __future__ import annotations

import io
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import trimesh
from PIL import Image

from data_prep.datasets.registry import open_dataset
from data_prep.files.clouds import save_ply
from data_prep.rendering.opengl import render
from data_prep.scene import View

pytestmark = pytest.mark.slow

REPOSITORY = Path(__file__).parent.parent
EXAMPLES = REPOSITORY / "examples"
NAMES = ("method", "metric", "extractor", "dataset", "condition")
CORNERS = np.array(np.meshgrid(*[[-0.5, 0.5]] * 3), np.float32).reshape(3, -1).T


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """The command line where both packages are installed."""
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
def run_folder(bench, tmp_path_factory):
    """A run of the method, beside the ceiling and the floor: 2 objects x 2 views x 2 conditions."""
    out = tmp_path_factory.mktemp("run") / "run"
    chosen = ("--methods", "convex-hull,true-mesh", "--conditions", "2048,noise-0.10")
    small = ("--limit", "2", "--views", "2", "--workers", "2", "--out", out)
    done = bench("run", "--suite", "chair-robustness", *chosen, *small)
    assert done.returncode == 0, done.stderr
    return out


def test_they_are_listed(bench):
    listed = bench("list").stdout.splitlines()
    assert "  convex-hull               of another installed package" in listed
    for name in ("pixel-error", "fd-edges"):
        assert f"  {name:<25} of another installed package; see 'bench score'" in listed
    assert "  dropout-half              of another installed package" in listed
    assert "  mesh-list:PATH            of another installed package" in listed


def test_the_method_is_run_and_stands_in_the_tables(run_folder):
    table = pd.read_csv(run_folder / "tables" / "table3_ssim.csv").set_index(["method", "metric"])
    ssim = table.loc[("convex-hull", "ssim")].set_index("condition")
    assert list(ssim.index) == ["2048", "noise-0.10"]
    assert (ssim["n_ok"] == 4).all()
    assert (ssim["n"] == 4).all()
    # A hull under noise is larger, and neither is a chair.
    assert 0 < ssim["value"]["noise-0.10"] < ssim["value"]["2048"] < 1


def test_the_metric_is_taken_of_the_run(bench, run_folder):
    """By the arithmetic of its closed form: zero for the truth, and for white images how dark the
    truth is. The tables of the run stay as they are."""
    before = {path: path.read_bytes() for path in (run_folder / "tables").iterdir()}
    done = bench("score", run_folder, "--metrics", "pixel-error")
    assert (done.returncode, done.stderr) == (0, "")
    assert {path: path.read_bytes() for path in before} == before
    markdown = (run_folder / "tables" / "metric_pixel-error.md").read_text()
    assert done.stdout.strip() == markdown.strip()
    title = markdown.splitlines()[0]
    assert title.startswith("# pixel-error, version 1: mean absolute difference of pixels in ")
    assert "(lower is better)" in title
    rows = pd.read_csv(run_folder / "tables" / "metric_pixel-error.csv")
    assert set(rows["metric"]) == {"pixel-error"}
    assert (rows["n_ok"] == rows["n"]).all()
    value = rows.set_index(["method", "condition"])["value"]
    assert (value["true-mesh"] == 0).all()
    assert value["convex-hull", "noise-0.10"] > value["convex-hull", "2048"] > 0
    records = pd.read_parquet(run_folder / "records.parquet")
    truths = []
    for shape in open_dataset("procedural").objects("chair", 2, 2):
        of_shape = records[(records["method"] == "blank") & (records["object"] == shape.object_id)]
        angles = of_shape[["azimuth_deg", "elevation_deg"]].drop_duplicates()
        truths.append(render(shape.load(), [View(*pair) for pair in angles.to_numpy()]))
    assert value["blank", "2048"] == pytest.approx(255 - np.mean(truths), abs=1e-6)


def test_the_metric_is_compared_and_recommended_by(bench, run_folder):
    """After `bench score`; before it the command is named."""
    methods = ("--methods", "convex-hull,true-mesh", "--metric", "pixel-error")
    budget = ("--budget-ms", "1e6", "--metric", "pixel-error")
    (run_folder / "scores" / "pixel-error.parquet").unlink(missing_ok=True)
    for arguments in (("compare", run_folder, *methods), ("recommend", run_folder, *budget)):
        refused = bench(*arguments)
        assert refused.returncode == 2
        assert f"run 'bench score {run_folder} --metrics pixel-error' first" in refused.stderr
    assert bench("score", run_folder, "--metrics", "pixel-error").returncode == 0
    compared = bench("compare", run_folder, *methods, "--format", "csv")
    assert compared.returncode == 0, compared.stderr
    rows = pd.read_csv(io.StringIO(compared.stdout))
    assert (rows["difference"] < 0).all()  # the truth is nearer to itself
    advised = bench("recommend", run_folder, *budget)
    # A hull fills the gaps of a chair with grey: more pixels are wrong than of a white image.
    value = pd.read_csv(run_folder / "tables" / "metric_pixel-error.csv").set_index("method")[
        "value"
    ]
    assert value["convex-hull"].min() > value["blank"].max()
    assert (advised.returncode, advised.stderr) == (1, "")
    assert "2048: no method within 1000000 ms is better than a white image" in advised.stdout
    assert bench("report", run_folder).returncode == 0
    assert "mean absolute difference of pixels" in (run_folder / "report.html").read_text()


def test_the_condition_is_run(bench, tmp_path):
    """About half of the points stay, other ones of each object; an export has them."""
    cells = ("--conditions", "2048,dropout-half", "--limit", "2", "--views", "1")
    out = tmp_path / "run"
    chosen = ("--suite", "chair-robustness", "--methods", "convex-hull", "--workers", "2")
    done = bench("run", *chosen, *cells, "--out", out)
    assert done.returncode == 0, done.stderr
    records = pd.read_parquet(out / "records.parquet").set_index(["method", "condition"])
    assert set(records.loc[("convex-hull", "dropout-half"), "outcome"]) == {"ok"}
    assert "loses half of its points" in (out / "report.html").read_text()
    exported = bench("data", "export", *cells, "--out", tmp_path / "inputs")
    assert exported.returncode == 0, exported.stderr
    clouds = pd.read_csv(tmp_path / "inputs" / "clouds.csv").set_index("condition")
    left = clouds.loc["dropout-half", "points"]
    assert left.nunique() == 2
    assert left.between(1024 - 5 * 22.7, 1024 + 5 * 22.7).all()  # five deviations of binomials
    refused = bench("run", *chosen, "--conditions", "dropout-hal", "--out", tmp_path / "no")
    assert refused.returncode == 2
    assert "unknown condition 'dropout-hal': did you mean 'dropout-half'" in refused.stderr


def test_distances_are_taken_of_the_run(bench, run_folder):
    """The distance of the truth is zero, and a hull is nearer to it than a white image is."""
    done = bench("score", run_folder, "--metrics", "fd-edges")
    assert (done.returncode, done.stderr) == (0, "")
    rows = pd.read_csv(run_folder / "tables" / "metric_fd-edges.csv")
    assert set(rows["metric"]) == {"fd-edges", "fd-edges-kernel"}
    value = rows.set_index(["metric", "method", "condition"])["value"]
    assert value["fd-edges", "true-mesh", "2048"] == pytest.approx(0, abs=1e-12)
    assert 0 < value["fd-edges", "convex-hull", "2048"] < value["fd-edges", "blank", "2048"]


def test_the_dataset_is_read_and_measured(bench, tmp_path):
    """Two boxes of other proportions, of which the list has one in the test split."""
    for name, tall in (("a", 1.0), ("b", 2.0)):
        trimesh.creation.box((1, 1, tall)).export(tmp_path / f"{name}.ply")
    (tmp_path / "objects.csv").write_text("test,chair,a.ply\ntrain,chair,b.ply\n")
    seen = bench("data", "inspect", f"mesh-list:{tmp_path}")
    assert seen.returncode == 0, seen.stderr
    assert "class        chair: test 1, train 1" in seen.stdout
    small = ("--methods", "true-mesh", "--conditions", "2048", "--views", "2")
    chosen = ("--suite", "chair-robustness", "--dataset", f"mesh-list:{tmp_path}")
    done = bench("run", *chosen, *small, "--out", tmp_path / "run")
    assert done.returncode == 0, done.stderr
    records = pd.read_parquet(tmp_path / "run" / "records.parquet")
    assert set(records["object"]) == {"a.ply"}
    (tmp_path / "objects.csv").write_text("test,chair,../a.ply\n")
    refused = bench("data", "inspect", f"mesh-list:{tmp_path}")
    assert refused.returncode == 2
    assert refused.stderr.endswith("objects.csv:1: a file outside the folder\n")


def test_it_draws_a_cloud_and_what_it_cannot_draw_fails_by_its_name(bench, tmp_path):
    """The hull of a cube's corners seen from the front is a square: its near face, unshaded.

    The camera stands at 4 from the middle of a cube whose corners are at radius 1: the near face,
    2/sqrt(3) wide, is at 4 - 1/sqrt(3). 232 px of focal length make that 78.3 px.
    """
    save_ply(CORNERS, tmp_path / "cube.ply")
    front = ("--azimuth", "0", "--elevation", "0", "-o", tmp_path / "cube.png")
    done = bench("render", tmp_path / "cube.ply", "--method", "convex-hull", *front)
    assert (done.returncode, done.stderr) == (0, "")
    with Image.open(tmp_path / "cube.png") as image:
        pixels = np.asarray(image)[:, :, 0]
    rows, columns = np.nonzero(pixels == 160)
    wide, high = np.ptp(columns) + 1, np.ptp(rows) + 1
    assert (wide, high) == (78, 78)  # whole pixels; the outermost ones are smoothed
    assert len(rows) == 78 * 78
    save_ply(CORNERS[:3], tmp_path / "three.ply")
    out = tmp_path / "three.png"
    done = bench("render", tmp_path / "three.ply", "--method", "convex-hull", "-o", out)
    assert done.returncode == 1
    assert done.stderr.startswith("bench: convex-hull: hull: QH6214 qhull input error: not enough")


@pytest.mark.parametrize("name", ["convex-hull", "pixel-error", "fd-edges", "dropout-half"])
def test_the_examples_keep_their_contracts(bench, name):
    done = bench("test", name)
    *lines, last = done.stdout.splitlines()
    assert [line for line in lines if not line.startswith("ok   ")] == []
    assert last.startswith("0 block a run, 0 warnings; next: bench ")
    ending = {"convex-hull": f"add {name} DIR", "dropout-half": f"--conditions {name}"}
    assert last.endswith(ending.get(name, f"--metrics {name}"))
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("name", ["mesh-list", "mesh_list:DATASET"])
def test_the_dataset_keeps_its_contract(bench, tmp_path, name):
    for file, tall in (("a", 1.0), ("b", 2.0)):
        trimesh.creation.box((1, 1, tall)).export(tmp_path / f"{file}.ply")
    (tmp_path / "objects.csv").write_text("test,chair,a.ply\ntest,chair,b.ply\n")
    done = bench("test", f"{name}:{tmp_path}")
    assert (done.returncode, done.stderr) == (0, ""), done.stdout
    last = done.stdout.splitlines()[-1]
    assert last.startswith("0 block a run, 0 warnings; next: ")
    assert last.endswith(f"bench run --suite thirteen-classes --dataset mesh-list:{tmp_path}")


def test_a_method_that_passes_works_in_the_other_commands(bench, run_folder):
    compared = bench("compare", run_folder, "--methods", "convex-hull,true-mesh")
    assert compared.returncode == 0, compared.stderr
    assert "convex-hull" in compared.stdout
    reported = bench("report", run_folder)
    assert reported.returncode == 0, reported.stderr
    assert "convex-hull" in (run_folder / "report.html").read_text()
