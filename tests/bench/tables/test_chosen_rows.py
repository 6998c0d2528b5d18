"""Rows that are another method by metric and condition, in tables and comparisons."""

from __future__ import annotations

import csv
import io
from dataclasses import replace
from itertools import product

import pytest

from bench.analysis.pairs import compare_methods, method_standing
from bench.analysis.run import read_run
from bench.catalogue.chosen import BEST_CLASSICAL, BEST_LEARNED_3D, CHOSEN, OTHER_METRICS
from bench.catalogue.methods import METHODS as CATALOGUE
from bench.catalogue.methods import role
from bench.catalogue.suites import SUITES
from bench.records.frames import read_records
from bench.tables.build import tables
from bench.tables.differences import differences_table
from bench.tables.quality import headline

from ..builders import rows_of, write_run

METHODS = ["surface-apss", "denoised-wrap", "splat", "blank"]
CHOICE = {
    ("ssim", "2048"): ("splat", "surface-apss"),
    ("ssim", "512"): ("surface-apss", "splat"),
    (OTHER_METRICS, "2048"): ("denoised-wrap", "surface-apss"),
    (OTHER_METRICS, "512"): ("surface-apss", "denoised-wrap"),
}


@pytest.fixture
def choice(monkeypatch):
    """A ranking that differs between two conditions, at the first also between metrics."""
    monkeypatch.setitem(CHOSEN, BEST_CLASSICAL, replace(CHOSEN[BEST_CLASSICAL], ranking=CHOICE))


@pytest.fixture
def directory(choice, tmp_path):
    objects = [f"chair/{name}" for name in "abcdefgh"]
    return write_run(tmp_path / "run", methods=METHODS, objects=objects)


def test_the_choice_is_among_two_or_more(choice):
    row = CHOSEN[BEST_CLASSICAL]
    at = ("lpips", "2048")
    assert row.best([at, ("ssim", "2048")], METHODS) == {
        at: "denoised-wrap",
        ("ssim", "2048"): "splat",
    }
    assert row.best([at], ["blank", "surface-apss"]) == {}
    assert row.best([("psnr", "512"), ("psnr", "unheard-of")], METHODS) == {
        ("psnr", "512"): "surface-apss"
    }
    assert role(BEST_CLASSICAL) == role(BEST_LEARNED_3D) == "chosen"


def test_one_network_that_learned_in_3d_is_enough():
    row = CHOSEN[BEST_LEARNED_3D]
    at = ("ssim", "512")
    assert row.best([at], ["occupancy-net", "blank"]) == {at: "occupancy-net"}
    assert row.best([at], METHODS) == {}


def test_the_strongest_differ_by_metric():
    """Two meshes and discs that fill the image are held to what was measured."""
    cells = [(m, c) for m in ("ssim", "ssim-object", "lpips") for c in ("2048", "noise-0.10")]
    best = CHOSEN[BEST_CLASSICAL].best(cells, ["alpha-wrap", "denoised-wrap", "splat-fill"])
    assert list(best.values()) == [*("alpha-wrap", "splat-fill") * 2, "alpha-wrap", "denoised-wrap"]


def test_every_ranking_is_of_what_there_is():
    """Each condition of a suite has a ranking of the same methods, none of them twice.

    Of larger clouds and scans none has been measured: tables have no chosen row there.
    """
    unranked = {"8192", "32768", "three-views", "one-side"}
    for row in CHOSEN.values():
        group = set(row.ranking[OTHER_METRICS, "2048"])
        metrics = {metric for metric, _ in row.ranking}
        for suite in SUITES:
            for cell in product(metrics, (c for c in suite.conditions if c not in unranked)):
                assert sorted(row.ranking[cell]) == sorted(group)


def test_all_that_learn_nothing_are_ranked():
    """One needs a package that is not always installed, and is measured by itself."""
    candidates = {
        method.id
        for method in CATALOGUE
        if method.kind in ("reconstruction", "splat") and method.trained_on == "nothing"
    }
    ranked = set(CHOSEN[BEST_CLASSICAL].ranking[OTHER_METRICS, "2048"])
    assert candidates == ranked | {"open3d-poisson"}


def test_the_row_has_the_values_of_the_chosen_method(directory):
    run = read_run(directory)
    for table in (*tables(run), headline(run)):
        rows = {(row.method, row.condition, row.metric): row for row in rows_of(table)}
        metrics = {metric for _, _, metric in rows}
        for metric in metrics:
            for condition in ("2048", "512"):
                chosen, _ = CHOICE.get((metric, condition), CHOICE[OTHER_METRICS, condition])
                row, its = (rows[name, condition, metric] for name in (BEST_CLASSICAL, chosen))
                assert (row.value, row.ci_low, row.n) == pytest.approx(
                    (its.value, its.ci_low, its.n), nan_ok=True
                )
                assert row.note == its.note if its.skipped else row.note.startswith(chosen)
    text = tables(run)[0].to_markdown()
    assert (
        "`best-classical`, chosen on validation objects, is by ssim `splat` at 2048; "
        "`surface-apss` at 512; by luminance, contrast, structure `denoised-wrap` at 2048; "
        "`surface-apss` at 512." in text
    )
    lines = [line for line in text.splitlines() if line.startswith("| best-classical |")]
    assert len(lines) == 4
    assert not any("**" in line for line in lines)  # the method itself is marked


def test_it_is_compared_by_its_name(directory):
    found = compare_methods(directory, ["best-classical", "splat"], ["lpips"])
    direct = {
        condition: compare_methods(directory, [chosen, "splat"], ["lpips"])
        for condition, chosen in (("2048", "denoised-wrap"), ("512", "surface-apss"))
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
    assert rows["2048"]["method_a"] == "best-classical"
    assert found.remarks == (
        "`best-classical`, chosen on validation objects, is `denoised-wrap` at 2048; "
        "`surface-apss` at 512.",
    )
    by_two = compare_methods(directory, ["best-classical", "blank"], ["ssim", "lpips"])
    assert "is by ssim `splat` at 2048; `surface-apss` at 512; by lpips " in by_two.remarks[0]
    values = by_two.rows.set_index(["metric", "condition"])
    assert values.loc[("ssim", "2048"), "images_of_a"] == "splat"
    assert values.loc[("lpips", "2048"), "images_of_a"] == "denoised-wrap"


def test_conditions_without_a_choice_are_left_out_of_a_comparison(directory, monkeypatch):
    only = {at: names for at, names in CHOICE.items() if at[1] == "2048"}
    monkeypatch.setitem(CHOSEN, BEST_CLASSICAL, replace(CHOSEN[BEST_CLASSICAL], ranking=only))
    found = compare_methods(directory, ["best-classical", "splat"], ["lpips"])
    assert found.remarks == (
        "512 left out: no `best-classical` has been chosen there.",
        "`best-classical`, chosen on validation objects, is `denoised-wrap` at 2048.",
    )
    direct = compare_methods(directory, ["denoised-wrap", "splat"], ["lpips"]).rows
    columns = ["condition", "value_a", "value_b", "difference"]
    expected = direct.loc[direct["condition"] == "2048", columns]
    assert found.rows[columns].values.tolist() == expected.values.tolist()
    _, against = method_standing(read_run(directory), "splat", ["splat"]).against[-1]
    assert (against.a, {*against.rows["condition"]}) == (BEST_CLASSICAL, {"2048"})


def test_an_added_method_is_compared_with_the_best_by_each_metric(directory):
    """The comparisons are those of `bench compare`, with the same corrections."""
    images = read_records(directory, ["method", "ssim_object", "lpips"]).groupby("method").mean()
    rivals = images.loc[["surface-apss", "denoised-wrap"]]
    best = {"ssim-object": rivals["ssim_object"].idxmax(), "lpips": rivals["lpips"].idxmin()}
    run = read_run(directory)
    compared = method_standing(run, "splat", ["splat"]).against
    assert {metric: d.a for by, d in compared for metric in by} == best
    assert compared[-1][1].a == BEST_CLASSICAL
    for _, differences in compared:
        pair = compare_methods(directory, [differences.a, "splat"], None)
        assert differences_table(differences).to_csv() == differences_table(pair).to_csv()
        assert {*differences.rows["method_b"]} == {"splat"}
    every = [name for name in METHODS if name != "blank"]
    assert method_standing(run, "splat", every).against[0][1].a == "blank"  # nothing else is there
