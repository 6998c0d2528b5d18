"""Measurements of the documentation: what their runs and files hold."""

from __future__ import annotations

import csv
import io
from itertools import product
from pathlib import Path

import pytest

from bench.analysis.paper import AVERAGE
from bench.catalogue.chosen import BEST_CLASSICAL, measured_methods
from bench.catalogue.methods import find_method
from bench.catalogue.suites import STABILITY
from bench.suites.stability.cases import CASES
from data_prep.datasets.protocol_version import PROTOCOL_VERSION
from studies import measurements
from studies.measurements import JUDGES, MEASUREMENTS, NUMBERS, differences_of, rivals_of

SMALL = measurements.QuotedRun(
    "--suite chair-robustness --methods alpha-wrap,splat,blank --conditions 2048 --limit 2 "
    "--views 2",
    ("splat",),
    ("lpips", "ssim"),
    (("headline", "first"),),
)


def lines(path: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(path.read_text())))


@pytest.mark.parametrize("name", [name for name in MEASUREMENTS if measurements.of_scores(name)])
def test_files_are_of_this_protocol_and_of_the_methods_that_their_run_measures(name):
    options = MEASUREMENTS[name].options.split()
    rows = lines(NUMBERS / f"{name}.csv")
    assert {row["protocol"] for row in rows} == {str(PROTOCOL_VERSION)}
    assert {row["suite"] for row in rows} == {options[options.index("--suite") + 1]}
    measured = {row["method"] for row in rows}
    if "--methods" in options:
        asked = options[options.index("--methods") + 1].split(",")
        assert all(find_method(method).id == method for method in asked)
        assert measured >= set(asked)
    pairs = lines(NUMBERS / differences_of(name)) if MEASUREMENTS[name].compared else []
    assert {row["method_b"] for row in pairs} == set(MEASUREMENTS[name].compared)
    assert {row["method_a"] for row in pairs} <= {BEST_CLASSICAL}
    rivals = lines(NUMBERS / rivals_of(name)) if MEASUREMENTS[name].rivals else []
    assert {row["method_b"] for row in rivals} == set(MEASUREMENTS[name].rivals)
    assert {row["method_a"] for row in rivals} <= {"fused-net@grey"}


def test_no_method_of_the_suite_stability_has_an_unexpected_outcome():
    kinds = {(row["subject"], row["case"]): row["kind"] for row in lines(NUMBERS / "stability.csv")}
    assert kinds.keys() == {*product(STABILITY.methods, [case.id for case in CASES])}
    assert {*kinds.values()} == {"holds", "refused", "differs", "contained"}


@pytest.mark.parametrize("name", [n for n, m in MEASUREMENTS.items() if m.metrics == JUDGES])
def test_further_metrics_have_the_mean_of_their_classes(name):
    cells: dict[tuple[str, ...], dict[str, float]] = {}
    for row in lines(NUMBERS / f"{name}.csv"):
        cell = row["method"], row["condition"], row["metric"]
        cells.setdefault(cell, {})[row["class"]] = float(row["value"])
    assert {metric for *_, metric in cells} == {*JUDGES}
    for cell, values in cells.items():
        average = values.pop(AVERAGE)
        assert len(values) == 13, cell
        # all of six decimals, so half a unit of each
        assert average == pytest.approx(sum(values.values()) / 13, abs=1e-6), cell


def test_a_run_of_speed_becomes_the_table_of_costs(tmp_path):
    """One view and each further one are those of one thread; scores are the published ones."""
    (tmp_path / "tables").mkdir()
    cells = [
        *("splat,2048,1,picture-of-1-core-ms,5", "splat,2048,1,further-view-core-ms,3"),
        *("splat,2048,2,picture-of-1-core-ms,99", "splat,2048,1,picture-of-20-core-ms,99"),
        *("alpha-wrap,2048,1,picture-of-1-core-ms,4", "splat,512,1,picture-of-1-core-ms,99"),
        *("alpha-wrap,2048,1,further-view-core-ms,1", "poisson,2048,1,picture-of-1-core-ms,"),
    ]
    text = "\n".join(["method,condition,threads,metric,value", *cells])
    (tmp_path / "tables" / "speed.csv").write_text(text)
    scores = {name: measured.score for name, measured in measured_methods().items()}
    head = "method,one_view_ms,further_view_ms,score\n"
    values = (f"alpha-wrap,4,1,{scores['alpha-wrap']:.4f}", f"splat,5,3,{scores['splat']:.4f}")
    assert measurements.costs(tmp_path) == head + "\n".join(values) + "\n"


def test_the_run_of_the_costs_measures_all_that_the_table_has():
    options = MEASUREMENTS["costs"].options.split()
    asked = options[options.index("--methods") + 1].split(",")
    assert {*asked} == {*measured_methods()}


@pytest.mark.slow
def test_a_run_becomes_its_files(tmp_path, monkeypatch):
    monkeypatch.setattr(measurements, "MEASUREMENTS", {"small": SMALL})
    run = tmp_path / "run"
    measurements.measure("small", run, None, numbers=tmp_path)
    values = lines(tmp_path / "small.csv")
    assert [(row["method"], row["metric"]) for row in values] == [
        (method, metric)
        for metric in ("ssim", "lpips")
        for method in ("alpha-wrap", BEST_CLASSICAL, "splat", "blank")
    ]
    of_run = lines(run / "tables" / "table3_ssim.csv")
    assert values[:4] == [row for row in of_run if row["metric"] == "ssim"]
    pairs = lines(tmp_path / "small-differences.csv")
    assert [row["metric"] for row in pairs] == list(SMALL.metrics)
    value = {(row["method"], row["metric"]): float(row["value"]) for row in values}
    for row in pairs:
        if row["metric"] != "ssim-object":  # paired means of two objects of as many views
            ours, best = (value[m, row["metric"]] for m in ("splat", BEST_CLASSICAL))
            # both printed with six decimals
            assert float(row["difference"]) == pytest.approx(ours - best, abs=1.5e-6)
    assert "run_a" not in pairs[0]
    assert (tmp_path / "first.csv").read_text() == (run / "tables" / "headline.csv").read_text()
    (line,) = lines(tmp_path / "measured.csv")
    assert (line["name"], line["command"]) == ("small", f"bench run {SMALL.options}")


def test_a_run_is_entered_with_its_date_commit_processor_and_command():
    """Lines of measurements that are no more go; the others stay, in the order of the list."""
    head = "name,date,commit,processor,command\n"
    old, gone = "costs,2026-11-01,aaaaaaaa,x,bench run\n", "gone,2026-11-01,bbbbbbbb,x,bench run\n"
    manifest = {
        "finished": "2026-11-27T20:30:00+00:00",
        "git": {"commit": "0123456789abcdef", "clean": True},
        "machine": {"cpu": "an AMD EPYC", "instructions": "family 25: avx2"},
    }
    text = measurements.measured(
        head + old + gone, "latent", manifest, ["bench", "run", "--suite", "latent"]
    )
    line = 'latent,2026-11-27,01234567,"an AMD EPYC, family 25: avx2",bench run --suite latent\n'
    assert text == head + line + old
