"""The suite beyond-training: the tables, figures and report of a finished run."""

from __future__ import annotations

import pandas as pd
import pytest

import bench.checking.golden
from bench.analysis.scored_run import read_run
from bench.catalogue.suites import SUITES
from bench.commands.publish import run_suite
from bench.records.run_folder import read_manifest
from bench.report.build import read_page
from bench.running.options import Options
from bench.tables.build import make_outputs, write_outputs
from data_prep.failures import BadInput

from ..builders import drop_features, write_run

SUITE = next(suite for suite in SUITES if suite.id == "beyond-training")
METHODS = ["surface-apss", "pc2pix", "splat", "true-mesh", "blank"]
CONDITIONS = ["512", "2048", "noise-0.05", "noise-0.20", "missing-0.50"]


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Return a run with random scores, of 3 objects x 2 views."""
    directory = tmp_path_factory.mktemp("beyond")
    return write_run(directory, suite=SUITE.id, methods=METHODS, conditions=CONDITIONS)


def test_table_and_check_know_the_leads(written, command, monkeypatch):
    """The golden values are of a method that the run does not have."""
    manifest = read_manifest(written)
    names = ("protocol", "dataset", "views", "seed")
    protocol = {name: manifest[name] for name in names} | {"objects": 3}
    none = {"method": "none", "condition": "none", "class": "chair", "metric": "ssim", "value": 0.5}
    golden = pd.DataFrame([protocol | none])
    monkeypatch.setattr(bench.checking.golden, "golden", lambda suite: golden)
    with pytest.raises(BadInput, match="nothing is compared"):
        bench.checking.golden.check(written)
    path = written / "tables" / "crossings.csv"
    before = path.read_bytes()
    path.write_bytes(before.replace(b"pc2pix", b"pc2pax", 1))
    (message,) = bench.checking.golden.check(written).regressions
    assert "crossings.csv: not what the records give" in message
    status, out, err = command("table", written, "--format", "md")
    assert (status, err) == (0, "")
    assert path.read_bytes() == before
    assert (written / "tables" / "crossings.md").read_text() in out


def test_runs_without_two_methods_families_or_features_have_less(tmp_path):
    methods = ["splat", "blank"]
    few = write_run(tmp_path / "a", suite=SUITE.id, methods=methods, conditions=CONDITIONS)
    drop_features(few, "fd-views")
    made = write_outputs(read_run(few))
    assert made.condition_sweep is None
    assert not (few / "tables" / "crossings.csv").exists()
    assert {*made.curves["metric"]} == {"ssim", "lpips", "silhouette-iou"}
    assert made.curves.groupby(["family", "metric", "method"]).ngroups == 3 * 2 * 3

    no_family = write_run(tmp_path / "b", suite=SUITE.id, conditions=["2048", "density-3"])
    outputs = make_outputs(read_run(no_family))
    assert (len(outputs.curves), outputs.condition_sweep) == (0, None)
    page = read_page(outputs)
    assert page["curves_title"] == "Robustness"
    assert ">ssim-object (higher is better)<" in page["first"][0]


@pytest.mark.slow
def test_a_run(tmp_path, no_machine):
    """1 object x 3 conditions x 2 methods, 2 views."""
    cells = {"methods": ("splat", "blank"), "conditions": ("2048", "outliers-0.10", "missing-0.50")}
    out = tmp_path / "run"
    done = run_suite(Options(SUITE.id, **cells, limit=1, views=2, workers=1, out=out))
    assert (done.done, done.failed) == (5, 0)
    assert done.outputs.curves
    found = {path.name for name in ("tables", "figures") for path in (out / name).iterdir()}
    tables = ("headline", "table_ssim", "table_frechet", "table_detail")
    assert found == {
        *(f"{name}.{kind}" for name in tables for kind in ("csv", "md")),
        *("beyond.png", "beyond.svg", "beyond-pictures.png"),
    }
