"""`bench surface`: scores of the meshes of a run."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from bench.analysis.surfaces import surface_rows
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
    assert "make a mesh are surface-bpa, surface-fit, alpha-wrap;" in refused(
        "surface", run, "--methods", "blank"
    )
