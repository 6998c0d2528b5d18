"""The suite speed-accuracy and `bench recommend`: a small run, and the command line."""

from __future__ import annotations

from dataclasses import replace

import pandas as pd
import pytest

from bench.analysis.scored_run import read_run
from bench.catalogue.methods import find_method, find_setting
from bench.catalogue.suites import SUITES
from bench.commands.publish import run_suite
from bench.records.run_folder import read_manifest
from bench.running.options import Options
from bench.tables.build import write_outputs
from data_prep.failures import BadInput

from ..builders import drop_features, read_all, write_all, write_run

pytestmark = pytest.mark.usefixtures("few_objects")

SURELY = ["surely", "good", "enough", "by", "ssim", "poisson"]
SUITE = next(suite for suite in SUITES if suite.id == "speed-accuracy")


def test_every_method_of_the_suite_is_known_and_values_of_a_parameter_rise():
    """The figure joins the values of a parameter in this order."""
    assert len(set(SUITE.methods)) == len(SUITE.methods)
    assert [find_method(method).id for method in SUITE.methods] == list(SUITE.methods)
    assert set(SUITE.frontier) <= {*SUITE.image_metrics, *SUITE.detail_metrics, *SUITE.set_metrics}
    values: dict[str, list[float]] = {}
    for method in SUITE.methods:
        if (setting := find_setting(method)) is not None:
            values.setdefault(setting.parameter.method, []).append(setting.value)
    assert values.keys() == {
        *("surface-apss", "surface-bpa", "poisson", "denoised-wrap", "splat"),
    }
    assert all(len(of_method) >= 3 for of_method in values.values())
    assert all(of_method == sorted(of_method) for of_method in values.values())


@pytest.mark.slow
def test_one_worker_does_all_and_leaves_tables_and_figures(tmp_path, tiny_weights, no_machine):
    """2 objects x 2 conditions x 4 methods, 2 views."""
    methods = ("splat@spread=2", "splat", f"pc2pix@{tiny_weights}", "blank")
    cells = {"methods": methods, "conditions": ("2048", "512")}
    traded = run_suite(Options(SUITE.id, **cells, limit=2, views=2, out=tmp_path / "run"))
    assert (traded.done, traded.failed) == (16, 0)
    assert read_manifest(traded.directory)["workers"] == 1
    assert ", nothing beside it; all 2 views of a cloud drawn in one call." in traded.outputs.cost
    tables = ("headline", "table_ssim", "table_frechet", "table_detail", "frontier", "points")
    figures = ("frontier", *(f"frontier-{metric}" for metric in SUITE.frontier[1:]))
    for folder, names, kinds in (
        ("tables", tables, ("csv", "md")),
        ("figures", figures, ("png", "svg")),
    ):
        found = {path.name for path in (traded.directory / folder).iterdir()}
        assert found == {f"{name}.{kind}" for name in names for kind in kinds}
    rows = pd.read_csv(traded.directory / "tables" / "frontier.csv")
    assert len(rows) == 2 * len(SUITE.frontier) * 4  # conditions x metrics x methods
    assert set(rows[rows["verdict"] == "reference"]["method"]) == {"blank"}


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Return a run with random scores; every method takes 250 ms a cloud and 125 ms a view."""
    return write_run(tmp_path_factory.mktemp("trade"), suite=SUITE.id)


def test_metrics_without_features_have_no_places(tmp_path):
    directory = write_run(tmp_path, suite=SUITE.id)
    drop_features(directory, "fd-views")
    frontier_tables = write_outputs(read_run(directory)).frontier_tables
    assert frontier_tables is not None
    metrics = frontier_tables[0].frame["metric"].unique().tolist()
    assert metrics == ["ssim-object", "lpips", "ssim", "structure", "silhouette-iou"]


@pytest.mark.parametrize("suite", ["stability", "latent"])
def test_runs_without_scores(tmp_path, suite):
    directory = write_run(tmp_path)
    manifest = directory / "manifest.json"
    manifest.write_text(manifest.read_text().replace("chair-robustness", suite))
    with pytest.raises(BadInput, match=f"a run of {suite} writes its tables itself"):
        read_run(directory).compared(["ssim"])


def test_surely_is_said_of_the_method_that_is(tmp_path, command):
    """The cheap one is good enough on average, the expensive one for certain."""
    directory = write_run(tmp_path, methods=["splat", "poisson", "blank"], conditions=["2048"])
    certain, scores = {"ssim": 0.9, "prepare_s": 2.0}, {"a": 0.3, "b": 0.5, "c": 0.7}
    records = [
        replace(r, **(certain if r.method == "poisson" else {"ssim": scores[r.object]}))
        for r in read_all(directory)
    ]
    write_all(directory, records)
    for least, choices in (
        ("0.45", [["good", "enough", "on", "average", "by", "ssim", "splat"], SURELY]),
        ("0.8", [SURELY]),
    ):
        status, out, _ = command("recommend", directory, "--min-ssim", least)
        _, _, heads, *lines = out.splitlines()
        assert status == 0
        # The metrics of the headline come first.
        assert heads.split()[3:6] == ["ssim-object", "lpips", "ssim"]
        assert [
            line.split()[1 : 1 + len(c)] for line, c in zip(lines, choices, strict=True)
        ] == choices
    full = ("--min-ssim", "0.45", "--budget-ms", "600", "--condition", "2048", "--metric", "ssim")
    _, out, _ = command("recommend", directory, *full)
    head, _, heads, best, short, sure, _, *remarks = out.splitlines()
    assert "it is not known what ran beside it" in head
    assert best.split()[1:5] == ["best", "by", "ssim", "splat"]
    assert "surely" not in short
    assert sure.split()[1 : 1 + len(SURELY)] == SURELY
    assert remarks[-1] == "2048, surely good enough by ssim: over the budget."


@pytest.mark.parametrize(
    ("arguments", "status", "message"),
    [
        (("--budget-ms", "10", "--views", "1"), 1, " 375 [375, 375]  375\n"),
        (("--min-ssim", "1"), 1, "none good enough, best by ssim  splat "),
    ],
)
def test_a_request_that_no_method_meets_or_that_has_no_sense(
    written, command, arguments, status, message
):
    found, out, err = command("recommend", written, *arguments)
    assert found == status
    assert message in (out if status == 1 else err)
    assert "true-mesh" not in out
