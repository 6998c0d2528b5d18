"""Metrics of other packages: found, refused by name, and taken of the pictures of a run."""

from __future__ import annotations

import sys

import numpy as np
import pandas as pd
import pytest

import bench.commands.score
from bench.catalogue.plugins import ImageMetric, find_metric, metric_ids
from bench.commands.score import checked_scores, score, scored
from bench.records.artifacts import Item
from bench.report.stored import open_sources
from bench.tables.build import read_scored
from bench.tables.quality import image_rows
from data_prep.failures import BadInput

from ..builders import install_stranger

MODULE = """
from bench.catalogue.plugins import ImageMetric
GOOD = ImageMetric("good", lambda truth, drawn: drawn[:, 0, 0, 0] * 1.0, 3, True, "a stranger's")
OTHER = ImageMetric("other-id", None, 1, True, "")
SPACED = ImageMetric("a/b", None, 1, True, "")
NO_METRIC = "text"
"""
ENTRIES = """
good = stranger:GOOD
other = stranger:OTHER
a/b = stranger:SPACED
no-metric = stranger:NO_METRIC
missing = stranger:MISSING
"""
TWO = np.zeros((2, 128, 128, 3), np.uint8)


@pytest.fixture
def stranger(tmp_path, monkeypatch):
    """An installed package that announces metrics, some of which it does not have."""
    metric_ids.cache_clear()
    monkeypatch.delitem(sys.modules, "stranger", raising=False)
    install_stranger(tmp_path, monkeypatch, "pc2pix_bench.metrics", MODULE, ENTRIES)
    yield
    metric_ids.cache_clear()


def made(function, id_="made", higher=True):
    return ImageMetric(id_, function, 7, higher, "made up")


# --- finding --------------------------------------------------------------------------------------


def test_metrics_of_other_packages_are_found_and_listed_without_being_loaded(stranger, command):
    assert find_metric("good").version == 3
    assert metric_ids() == ("a/b", "good", "missing", "no-metric", "other")
    status, out, _ = command("list")
    assert status == 0
    assert "  missing                   of another installed package; see 'bench score'" in out


@pytest.mark.parametrize(
    ("metric", "problem"),
    [
        ("other", "stranger:OTHER is not a bench.image_metric.ImageMetric with that id"),
        ("no-metric", "stranger:NO_METRIC is not a bench.image_metric.ImageMetric with "),
        ("missing", "stranger:MISSING cannot be loaded (AttributeError: "),
        ("a/b", "an id is kebab-case, it names files; rename it"),
    ],
)
def test_what_a_package_announces_and_has_not_is_refused_by_name(stranger, metric, problem):
    with pytest.raises(BadInput) as error:
        find_metric(metric)
    assert str(error.value).startswith(f"metric '{metric}' of stranger: {problem}")
    with pytest.raises(BadInput, match="unknown metric 'goods': did you mean 'good'"):
        find_metric("goods")


def test_without_other_packages_there_is_none(command, tmp_path):
    metric_ids.cache_clear()
    with pytest.raises(BadInput, match="unknown metric 'ssim': no installed package adds one"):
        find_metric("ssim")
    status, out, err = command("score", tmp_path)
    assert (status, out) == (2, "")
    assert err == "bench: no installed package adds a metric; see docs/adding-a-metric.md\n"


# --- scores ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (lambda truth, drawn: 1 / 0, "ZeroDivisionError: division by zero"),
        (lambda truth, drawn: "x", "ValueError: could not convert string to float"),
        (lambda truth, drawn: 1.0, r"gives \(\) values, 1 finite, for 2 pictures"),
        (lambda truth, drawn: [1.0, np.nan], r"gives \(2,\) values, 1 finite, for 2 pictures"),
        (lambda truth, drawn: np.ones((2, 1)), r"gives \(2, 1\) values, 2 finite, for 2 pict"),
    ],
)
def test_a_metric_that_gives_no_scores_is_named(function, message):
    with pytest.raises(BadInput, match=f"metric 'made': {message}.*fix that package"):
        checked_scores(made(function), TWO, TWO)


def test_true_and_drawn_images_in_their_order():
    metric = made(lambda truth, drawn: truth[:, 0, 0, 0] - 2.0 * drawn[:, 0, 0, 0])
    found = checked_scores(metric, TWO + 9, TWO + 2)
    assert found.dtype == np.float64
    assert found.tolist() == [5, 5]


@pytest.fixture
def metrics(monkeypatch):
    """Metrics by their ids, as if they were installed."""
    found = {}
    monkeypatch.setattr(bench.commands.score, "find_metric", found.__getitem__)
    return found


def test_every_image_counts_where_it_belongs(copied, metrics):
    """The ceiling draws the same under noise, splats grow with it, and the floor is blank."""
    dark = made(lambda truth, drawn: (drawn < 255).any(axis=3).mean(axis=(1, 2)), "dark-share")
    metrics["dark-share"] = dark
    (table,) = score(copied, ["dark-share"])
    value = {(row.method, row.condition): row.value for row in table.rows}
    assert value["blank", "2048"] == 0
    assert value["true-mesh", "2048"] == value["true-mesh", "noise-0.10"] > 0
    assert value["splat", "noise-0.10"] > value["splat", "2048"] > 0
    assert table.title == "dark-share, version 7: made up (higher is better)"
    written = pd.read_csv(copied / "tables" / "metric_dark-share.csv")
    assert written["value"].tolist() == pytest.approx([row.value for row in table.rows], abs=1e-6)
    assert all(row.ci_low <= row.value <= row.ci_high for row in table.rows)


def test_scores_stand_with_their_own_views(finished):
    run = read_scored(finished[0])
    sources = open_sources(finished[0], run.manifest, ())
    light = made(lambda truth, drawn: drawn.mean(axis=(1, 2, 3)), "light")
    values = scored(run.records, sources, light)
    for record in values[values["method"] == "splat"].to_dict("records"):
        names = ("method", "condition", "class", "object")
        images = sources.images(Item(*(record[name] for name in names)))
        assert images[0].mean() != images[1].mean()
        assert record["light"] == images[record["view"]].mean()


def test_failed_images_are_scored_as_blank_ones(finished):
    """Every second picture of the ceiling fails: it scores 0 where blank scores 1."""
    run = read_scored(finished[0])
    failed = (run.records["method"] == "true-mesh") & (run.records["view"] == 1)
    broken = run.records.assign(
        outcome=run.records["outcome"].mask(failed, "failed"),
        reason=failed.map({True: "x: y", False: ""}),
    )
    blank = made(lambda truth, drawn: (drawn == 255).all(axis=(1, 2, 3)) * 1.0, "is-blank")
    values = scored(broken, open_sources(finished[0], run.manifest, ()), blank)
    assert values.loc[failed, "is_blank"].isna().all()
    assert values.loc[~failed, "is_blank"].notna().all()
    rows = image_rows(["is-blank"], values, run.suite, {})
    (row,) = (r.row for r in rows if (r.row.method, r.row.condition) == ("true-mesh", "2048"))
    assert (row.value, row.failures_as_blank, row.n_ok, row.n) == (0, 0.5, 3, 6)


def test_a_taken_name_and_images_that_are_gone_are_refused(copied, metrics):
    metrics["silhouette-iou"] = made(lambda truth, drawn: None, "silhouette-iou")
    with pytest.raises(BadInput, match="metric 'silhouette-iou': the records have a column of"):
        score(copied, ["silhouette-iou"])
    metrics["made"] = made(lambda truth, drawn: np.ones(len(drawn)))
    for path in (copied / "artifacts").rglob("*.npz"):
        path.unlink()
    with pytest.raises(BadInput, match="its pictures are not there any more; start the run again"):
        score(copied, ["made"])
