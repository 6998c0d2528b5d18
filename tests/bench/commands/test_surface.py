"""`bench surface`: scores of the meshes of a run, and whether they order as images do."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from scipy.stats import spearmanr

from bench.analysis.surfaces import rank_rows, surface_rows
from bench.metrics.surface_distance import SURFACE_METRICS
from bench.records.job import JOB
from data_prep.datasets.registry import open_dataset

from ..builders import write_run

METHODS = ("surface-bpa", "surface-fit", "alpha-wrap")
OBJECTS = [*((name, str(i)) for name in ("chair", "sofa") for i in range(6))]


@pytest.fixture
def meshes() -> pd.DataFrame:
    """Return random scores of all methods on all objects, of which one has no mesh."""
    random = np.random.default_rng(4)
    names = [(method, "2048", *obj) for method in METHODS for obj in OBJECTS]
    frame = pd.DataFrame(names, columns=JOB)
    frame[[*SURFACE_METRICS]] = random.random((len(frame), 3))
    frame["note"] = ""
    frame.loc[0, [*SURFACE_METRICS, "note"]] = [np.nan] * 3 + ["timeout: 120 s"]
    return frame


def test_means_are_over_classes_and_failures_are_counted(meshes):
    row = surface_rows(meshes).iloc[0]  # chamfer of the first method
    of_class = meshes[meshes["method"] == METHODS[0]].groupby("class")["chamfer"].mean()
    assert row["value"] == pytest.approx(of_class.mean())
    counts = row[["class", "n_ok", "n", "note"]].tolist()
    assert counts == ["average", 11, 12, "1 x timeout: 120 s"]
    assert row["ci_low"] < row["value"] < row["ci_high"]


def test_ranks_are_those_of_scipy_and_of_the_objects_that_all_methods_have(meshes):
    lpips = np.random.default_rng(5).random(len(meshes))
    jobs = meshes.assign(lpips_sum=2 * lpips, lpips_count=2)
    jobs = jobs.assign(ssim_sum=3 - 30 * meshes["chamfer"].fillna(0), ssim_count=3)[::-1]
    rows = rank_rows(meshes, jobs, ["lpips", "ssim"])
    rows = rows.set_index(["over", "surface_metric", "image_metric"])
    known = meshes.assign(lpips=lpips)[meshes["object"].ne("0") | meshes["class"].eq("sofa")]
    means = known.groupby(["method", "class"])[["f-score", "lpips"]].mean().groupby("method").mean()
    within = [spearmanr(m["f-score"], -m["lpips"])[0] for _, m in known.groupby("method")]
    expected = {
        "methods": spearmanr(means["f-score"], -means["lpips"])[0],
        "objects": np.mean(within),
    }
    for over, value in expected.items():
        row = rows.loc[(over, "f-score", "lpips")]
        assert row[["value", "n_ok", "n", "methods"]].tolist() == pytest.approx([value, 11, 12, 3])
        assert row["ci_low"] < value < row["ci_high"] or abs(value) == 1
        # An image metric that falls as the distance grows.
        best = rows.loc[(over, "chamfer", "ssim"), ["value", "ci_low"]].tolist()
        assert best == pytest.approx([1, 1])


def test_a_run_is_measured_once_and_says_who_makes_a_mesh(tmp_path, command, refused):
    chairs = open_dataset("procedural").objects("chair", 2, 2)
    run = write_run(
        tmp_path,
        methods=[*METHODS, "true-mesh", "blank"],
        conditions=["2048"],
        dataset="procedural",
        objects=[f"chair/{chair.object_id}" for chair in chairs],
    )
    assert command("surface", run, "--methods", METHODS[0])[0] == 0
    kept = pd.read_csv(run / "tables" / "surface_meshes.csv").assign(chamfer=0.125)
    kept.to_csv(run / "tables" / "surface_meshes.csv", index=False)  # what is there is taken
    status, out, _ = command("surface", run, "--workers", "1")
    rows = pd.read_csv(run / "tables" / "surface.csv").set_index(["method", "metric"])
    assert (status, rows.loc[(METHODS[0], "chamfer"), "value"]) == (0, 0.125)
    assert rows.loc[("alpha-wrap", "chamfer"), "value"] < 0.03
    assert out.startswith((run / "tables" / "surface.md").read_text())
    assert len(pd.read_csv(run / "tables" / "surface_ranks.csv")) == 12
    assert "make a mesh are surface-bpa, surface-fit, alpha-wrap;" in refused(
        "surface", run, "--methods", "blank"
    )
    status, out, _ = command("surface", run, "--methods", METHODS[0])
    assert (status, "Do surfaces predict images?" in out) == (0, False)  # of a single method
    assert not (run / "tables" / "surface_ranks.csv").exists()
