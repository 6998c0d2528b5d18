"""Metrics of other packages on the images of a run."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from bench.analysis.scored import read_scored
from bench.analysis.scores import image_rows
from bench.catalogue.metrics import ON_REQUEST, WeightsSource
from bench.catalogue.on_request import find_scorer, weights_of
from bench.catalogue.plugins import ImageMetric, SetMetric
from bench.commands.score import (
    KeptFeatures,
    checked_features,
    checked_scores,
    score,
    scored,
)
from bench.metrics.dists import dists
from bench.metrics.efficientnet import load_efficientnet
from bench.metrics.frechet import frechet_distance
from bench.metrics.inception_weights import WeightsUnavailable
from bench.metrics.kernel_distance import kernel_distance
from bench.metrics.learned_weights import find_efficientnet_weights
from bench.records.artifacts import JobName
from bench.records.record import GROUND_TRUTH
from bench.report.stored import open_sources
from data_prep.failures import BadInput

TWO = np.zeros((2, 128, 128, 3), np.uint8)


def made(function, id_="made", higher=True):
    return ImageMetric(id_, function, 7, higher, "made up")


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (lambda truth, drawn: 1 / 0, "ZeroDivisionError: division by zero"),
        (lambda truth, drawn: sys.exit(0), "SystemExit: 0"),
        (lambda truth, drawn: "x", "ValueError: could not convert string to float"),
        (lambda truth, drawn: 1.0, r"gives \(\) values, 1 finite, for 2 images"),
        (lambda truth, drawn: [1.0, np.nan], r"gives \(2,\) values, 1 finite, for 2 images"),
        (lambda truth, drawn: np.ones((2, 1)), r"gives \(2, 1\) values, 2 finite, for 2 imag"),
    ],
)
def test_a_metric_that_gives_no_scores_is_named(function, message):
    with pytest.raises(BadInput, match=f"metric 'made': {message}.*fix that package"):
        checked_scores(made(function), TWO, TWO)


def test_no_finite_value_of_identical_images(capsys):
    """Images of `true-mesh` are identical; the output of the metric is no part of the tables."""

    def decibels(truth, drawn):
        print("measuring")
        return np.full(len(drawn), np.inf)

    with pytest.raises(BadInput, match=r"for 2 images; they are identical to the true ones; fix"):
        checked_scores(made(decibels), TWO, TWO)
    with pytest.raises(BadInput, match=r"for 2 images; fix that package \('bench test made'\)"):
        checked_scores(made(decibels), TWO, TWO + 1)
    assert capsys.readouterr() == ("", "measuring\nmeasuring\n")


def test_true_and_drawn_images_in_their_order():
    metric = made(lambda truth, drawn: truth[:, 0, 0, 0] - 2.0 * drawn[:, 0, 0, 0])
    found = checked_scores(metric, TWO + 9, TWO + 2)
    assert (found.dtype, found.tolist()) == (np.float64, [5, 5])


@pytest.mark.usefixtures("few_objects")
def test_every_image_counts_where_it_belongs(copied):
    """true-mesh draws the same under noise, splats grow with it, and blank has no pixel."""
    dark = made(lambda truth, drawn: (drawn < 255).any(axis=3).mean(axis=(1, 2)), "dark-share")
    (table,) = score(copied, [dark])
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
        images = sources.images(JobName(*(record[name] for name in names)))
        assert images[0].mean() != images[1].mean()
        assert record["light"] == images[record["view"]].mean()


def test_failed_images_are_scored_as_blank_ones(finished):
    """Every second image of true-mesh fails: it scores 0 where blank scores 1."""
    run = read_scored(finished[0])
    failed = (run.records["method"] == "true-mesh") & (run.records["view"] == 1)
    outcomes = run.records["outcome"].mask(failed, "failed")
    broken = run.records.assign(outcome=outcomes, reason=failed.map({True: "x: y", False: ""}))
    blank = made(lambda truth, drawn: (drawn == 255).all(axis=(1, 2, 3)) * 1.0, "is-blank")
    values = scored(broken, open_sources(finished[0], run.manifest, ()), blank)
    assert (values["is_blank"].isna() == failed).all()
    rows = image_rows(replace(run, records=values), ["is-blank"])
    (row,) = (r.row for r in rows if (r.row.method, r.row.condition) == ("true-mesh", "2048"))
    assert (row.value, row.failures_as_blank, row.n_ok, row.n) == (0, 0.5, 3, 6)


def test_a_taken_name_and_images_that_are_gone_are_refused(copied):
    taken = made(lambda truth, drawn: None, "silhouette-iou")
    with pytest.raises(BadInput, match="metric 'silhouette-iou': the records have a column of"):
        score(copied, [taken])
    for path in (copied / "artifacts").rglob("*.npz"):
        path.unlink()
    with pytest.raises(BadInput, match="its images are gone; start the run again"):
        score(copied, [made(lambda truth, drawn: np.ones(len(drawn)))])


def of_set(function, id_="fd-made"):
    return SetMetric(id_, function, 3, "made up")


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (lambda images: 1 / 0, "ZeroDivisionError: division by zero"),
        (lambda images: np.ones(2), r"gives features \[2\], 2 finite, for 2 images"),
        (lambda images: np.ones((2, 0)), r"gives features \[2, 0\], 0 finite, for 2 images"),
        (lambda images: np.ones((1, 4)), r"gives features \[1, 4\], 4 finite, for 2 images"),
        (lambda images: np.full((2, 2), np.nan), r"gives features \[2, 2\], 0 finite, for 2"),
    ],
)
def test_an_extractor_that_gives_no_features_is_named(function, message):
    with pytest.raises(BadInput, match=f"metric 'fd-made': {message}.*fix that package"):
        checked_features(of_set(function), TWO)


@pytest.mark.usefixtures("few_objects")
def test_distances_of_an_extractor_are_those_of_its_features(copied):
    """The true images are those of the same objects and views."""

    def features(images):
        return np.stack([images.mean(axis=(1, 2, 3)), images.std(axis=(1, 2, 3))], axis=1)

    (table,) = score(copied, [of_set(features)])
    value = {(row.metric, row.method, row.condition): row.value for row in table.rows}
    run = read_scored(copied)
    sources = open_sources(copied, run.manifest, ())
    objects = sorted(run.records["object"].unique())
    drawn, true = (
        np.concatenate(
            [features(sources.images(JobName(method, condition, "chair", obj))) for obj in objects]
        )
        for method, condition in (("splat", "noise-0.10"), (GROUND_TRUTH, ""))
    )
    found = value["fd-made", "splat", "noise-0.10"]
    assert found == pytest.approx(frechet_distance(drawn, true), rel=1e-9)
    found = value["fd-made-kernel", "splat", "noise-0.10"]
    assert found == pytest.approx(kernel_distance(drawn, true), rel=1e-9)
    assert value["fd-made", "true-mesh", "2048"] == pytest.approx(0, abs=1e-9)
    assert table.title == "fd-made, version 3: made up (lower is better)"


def test_features_of_the_truth_are_taken_once(copied):
    asked = []

    def features(images):
        asked.append(images.mean())
        return np.ones((len(images), 1))

    run = read_scored(copied)
    seen = KeptFeatures(run.records, open_sources(copied, run.manifest, ()), of_set(features))
    for condition in ("2048", "noise-0.10"):
        images = seen.images("splat", condition, "chair")
        assert images == seen.images(GROUND_TRUTH, "", "chair")
        for method, seen_at in (("splat", condition), (GROUND_TRUTH, "")):
            assert seen.of(method, seen_at, "chair", images).shape == (len(images), 1)
    objects = len({obj for obj, _ in images})
    assert len(asked) == 3 * objects  # the truth, and splats at two conditions


def images_of(run, method, condition=""):
    """The images of a method, object by object, and those of the truth."""
    sources = open_sources(run.directory, run.manifest, ())
    objects = sorted(run.records["object"].unique())
    names = [JobName(method, condition, "chair", obj) for obj in objects]
    return [
        np.concatenate([sources.images(n) for n in of]) for of in (names, [n.truth for n in names])
    ]


@pytest.mark.usefixtures("few_objects")
def test_metrics_on_request_are_those_of_their_functions(copied):
    tables = score(copied, [find_scorer(name) for name in ON_REQUEST])
    value = {
        (row.metric, row.method, row.condition): row.value for table in tables for row in table.rows
    }
    assert {metric for metric, _, _ in value} == set(ON_REQUEST)
    run = read_scored(copied)
    drawn, true = images_of(run, "splat", "noise-0.10")
    expected = dists(true, drawn, single=True).mean()
    assert value["dists", "splat", "noise-0.10"] == pytest.approx(expected, rel=1e-5)
    drawn, true = (
        load_efficientnet(find_efficientnet_weights()).features(images) for images in (drawn, true)
    )
    found = value["fd-effnet", "splat", "noise-0.10"]
    assert found == pytest.approx(frechet_distance(drawn, true), rel=1e-4)
    found = value["kd-effnet", "splat", "noise-0.10"]
    assert found == pytest.approx(kernel_distance(drawn, true), rel=1e-4)
    for metric, best in (("dists", 0), ("fd-effnet", 0)):
        assert value[metric, "true-mesh", "2048"] == pytest.approx(best, abs=1e-4)
        assert value[metric, "blank", "2048"] == value[metric, "blank", "noise-0.10"] > 0.1
    # Too few images for a share: 10 neighbours are needed, and this run has 6 images of a cell.
    (row, *_) = (row for row in tables[-1].rows if row.method == "splat")
    assert (np.isnan(row.value), row.note) == (True, "fewer than 11 pictures")
    assert tables[-1].title.endswith("k = 10 (higher is better)")
    assert tables[0].title == (
        "dists, version 1: structure and texture of the features of VGG16; 0 is identical "
        "(lower is better)"
    )


@pytest.mark.parametrize("metric_id", ["dists", "fd-effnet"])
def test_a_judge_without_its_package_is_skipped_with_the_remedy(metric_id, copied):
    reason = "the package is not installed; run 'bench doctor --install'"

    def absent(chosen):
        raise WeightsUnavailable(reason)

    metrics = [find_scorer(metric_id), made(lambda truth, drawn: drawn[:, 0, 0, 0] * 1.0)]
    sources = {metric_id: WeightsSource(metric_id, absent)}
    judge, other = score(copied, metrics, weights=sources.get)
    assert {row.note for row in judge.rows} == {f"skipped: weights; {reason}"}
    assert all(row.skipped and np.isnan(row.value) for row in judge.rows)
    assert all(np.isfinite(row.value) for row in other.rows)
    assert "skipped" in judge.to_markdown()


def test_every_metric_on_request_has_weights_and_no_other():
    assert all(
        weights_of(metric).id in (metric, "fd-effnet", "fd-alexnet") for metric in ON_REQUEST
    )
    assert weights_of("edges") is None
