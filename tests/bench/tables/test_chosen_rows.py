"""Rows that are another method at each condition, in tables and comparisons."""

from __future__ import annotations

import csv
import io
from dataclasses import replace

import pytest

from bench.analysis.run_pairs import methods_of_run, standing
from bench.analysis.scored_run import read_run
from bench.catalogue.chosen import BEST_LEARNED_3D, BEST_RECONSTRUCTION, CHOSEN
from bench.catalogue.methods import METHODS as CATALOGUE
from bench.catalogue.methods import role
from bench.catalogue.suites import SUITES
from bench.records.frames import read_records
from bench.tables.build import tables
from bench.tables.differences import differences_table
from bench.tables.quality import headline

from ..builders import rows_of, write_run

METHODS = ["surface-apss", "denoised-wrap", "splat", "blank"]
CHOICE = {"2048": ("denoised-wrap", "surface-apss"), "512": ("surface-apss", "denoised-wrap")}


@pytest.fixture
def choice(monkeypatch):
    """A ranking that differs between two conditions."""
    row = CHOSEN[BEST_RECONSTRUCTION]
    monkeypatch.setitem(CHOSEN, row.id, replace(row, ranking={**row.ranking, **CHOICE}))


@pytest.fixture
def directory(choice, tmp_path):
    objects = [f"chair/{name}" for name in "abcdefgh"]
    return write_run(tmp_path / "run", methods=METHODS, objects=objects)


def test_the_choice_is_among_two_or_more(choice):
    row = CHOSEN[BEST_RECONSTRUCTION]
    assert row.by_condition(["2048"], METHODS) == {"2048": "denoised-wrap"}
    assert row.by_condition(["512"], ["blank", "surface-apss"]) == {}
    assert row.by_condition(["512", "unheard-of"], METHODS) == {"512": "surface-apss"}
    assert role(BEST_RECONSTRUCTION) == role(BEST_LEARNED_3D) == "chosen"


def test_one_network_that_learned_in_3d_is_enough():
    row = CHOSEN[BEST_LEARNED_3D]
    assert row.by_condition(["512"], ["occupancy-net", "blank"]) == {"512": "occupancy-net"}
    assert row.by_condition(["512"], METHODS) == {}


def test_every_ranking_is_of_what_there_is():
    """Each condition of a suite has a ranking of the same methods, none of them twice."""
    for row in CHOSEN.values():
        group = set(row.ranking["2048"])
        for suite in SUITES:
            for condition in suite.conditions:
                assert sorted(row.ranking[condition]) == sorted(group)


def test_all_that_learn_nothing_are_ranked():
    """One needs a package that is not always installed, and is measured by itself."""
    candidates = {
        method.id
        for method in CATALOGUE
        if method.kind in ("reconstruction", "splat") and method.trained_on == "nothing"
    }
    assert candidates == set(CHOSEN[BEST_RECONSTRUCTION].ranking["2048"]) | {"open3d-poisson"}


def test_the_row_has_the_values_of_the_chosen_method(directory):
    run = read_run(directory)
    for table in (*tables(run), headline(run)):
        rows = {(row.method, row.condition, row.metric): row for row in rows_of(table)}
        metrics = {metric for _, _, metric in rows}
        for metric in metrics:
            for condition, (chosen, _) in CHOICE.items():
                row, its = (rows[name, condition, metric] for name in (BEST_RECONSTRUCTION, chosen))
                assert (row.value, row.ci_low, row.n) == pytest.approx(
                    (its.value, its.ci_low, its.n), nan_ok=True
                )
                assert row.note == its.note if its.skipped else row.note.startswith(chosen)
    text = tables(run)[0].to_markdown()
    assert (
        "`best-reconstruction`, chosen on validation objects, is `denoised-wrap` at 2048; "
        "`surface-apss` at 512." in text
    )
    lines = [line for line in text.splitlines() if line.startswith("| best-reconstruction |")]
    assert len(lines) == 4
    assert not any("**" in line for line in lines)  # the method itself is marked


def test_it_is_compared_by_its_name(directory):
    found = methods_of_run(directory, ["best-reconstruction", "splat"], ["ssim"])
    direct = {
        condition: methods_of_run(directory, [chosen, "splat"], ["ssim"])
        for condition, (chosen, _) in CHOICE.items()
    }
    rows = {
        row["condition"]: row
        for row in csv.DictReader(io.StringIO(differences_table(found).to_csv()))
    }
    for condition, one in direct.items():
        (expected,) = [
            row
            for row in csv.DictReader(io.StringIO(differences_table(one).to_csv()))
            if row["condition"] == condition
        ]
        for name in ("value_a", "value_b", "difference", "ci_low", "ci_high", "p"):
            assert rows[condition][name] == expected[name]
    assert rows["2048"]["method_a"] == "best-reconstruction"
    assert found.remarks == (
        "`best-reconstruction` is `denoised-wrap` at 2048, `surface-apss` at 512.",
    )


def test_an_added_method_is_compared_with_the_best_by_each_metric(directory):
    """The comparisons are those of `bench compare`, with the same corrections."""
    images = read_records(directory, ["method", "ssim_object", "lpips"]).groupby("method").mean()
    rivals = images.loc[["surface-apss", "denoised-wrap"]]
    best = {"ssim-object": rivals["ssim_object"].idxmax(), "lpips": rivals["lpips"].idxmin()}
    run = read_run(directory)
    compared = standing(run, "splat", ["splat"]).against
    assert {metric: d.a for by, d in compared for metric in by} == best
    assert compared[-1][1].a == BEST_RECONSTRUCTION
    for _, differences in compared:
        pair = methods_of_run(directory, [differences.a, "splat"], None)
        assert differences_table(differences).to_csv() == differences_table(pair).to_csv()
        assert {*differences.cells["method_b"]} == {"splat"}
    every = [name for name in METHODS if name != "blank"]
    assert standing(run, "splat", every).against[0][1].a == "blank"  # nothing else is there
