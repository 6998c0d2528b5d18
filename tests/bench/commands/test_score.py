"""Metrics of other packages on the images of a run."""

from __future__ import annotations

import json
import re
import sqlite3
import sys
from contextlib import closing
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from bench.analysis.run import read_run
from bench.catalogue.plugins import ImageMetric, SetMetric
from bench.commands.config import read_config
from bench.finish import score_run
from bench.metrics.frechet import frechet_distance
from bench.metrics.inception_weights import WeightsUnavailable
from bench.metrics.kernel_distance import kernel_distance
from bench.records.folder import open_folder
from bench.records.frames import read_scores
from bench.records.job import GROUND_TRUTH, JOB, JobName
from bench.records.store import STORE
from bench.report.images import open_sources
from bench.scoring import checked_features, checked_scores, digits_of
from bench.tables.build import make_outputs
from bench.tables.quality import further_tables
from data_prep.datasets.protocol_version import PROTOCOL_VERSION
from data_prep.failures import BadInput

from ..builders import as_failed, damage_images, rows_of


def score(directory, metrics):
    return score_run(read_run(directory), metrics)


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
        (lambda truth, drawn: [np.inf] * 2, "for 2 images; they are identical to the true ones"),
        (lambda images: 1 / 0, "ZeroDivisionError: division by zero"),
        (lambda images: np.ones(2), r"gives features \[2\], 2 finite, for 2 images"),
        (lambda images: np.ones((2, 0)), r"gives features \[2, 0\], 0 finite, for 2 images"),
        (lambda images: np.ones((1, 4)), r"gives features \[1, 4\], 4 finite, for 2 images"),
        (lambda images: np.full((2, 2), np.nan), r"gives features \[2, 2\], 0 finite, for 2"),
    ],
)
def test_a_metric_that_gives_no_values_is_named(function, message):
    if function.__code__.co_argcount == 2:
        call = partial(checked_scores, made(function), TWO, TWO)
    else:
        call = partial(checked_features, of_set(function), TWO)
    with pytest.raises(BadInput, match=f"made': .*{message}.*fix that package"):
        call()


def test_true_and_drawn_images_in_their_order_and_output_on_stderr(capsys):
    """The output of a metric is no part of the tables."""

    def difference(truth, drawn):
        print("measuring")
        return truth[:, 0, 0, 0] - 2.0 * drawn[:, 0, 0, 0]

    scores = checked_scores(made(difference), TWO + 9, TWO + 2)
    assert (scores.dtype, scores.tolist()) == (np.float64, [5, 5])
    assert capsys.readouterr() == ("", "measuring\n")


@pytest.mark.usefixtures("few_objects")
def test_every_image_counts_where_it_belongs(copied):
    """true-mesh draws the same under noise, splats grow with it, and blank has no pixel."""
    dark = made(lambda truth, drawn: (drawn < 255).any(axis=3).mean(axis=(1, 2)), "dark-share")
    (table,) = score(copied, [dark])
    value = {(row.method, row.condition): row.value for row in rows_of(table)}
    assert value["blank", "2048"] == 0
    assert value["true-mesh", "2048"] == value["true-mesh", "noise-0.10"] > 0
    assert value["splat", "noise-0.10"] > value["splat", "2048"] > 0
    assert table.title == (
        "dark-share, version 7: made up (higher is better); against the true mesh in its colours; "
        f"protocol {PROTOCOL_VERSION}"
    )
    assert all(row.ci_low <= row.value <= row.ci_high for row in rows_of(table))


def test_scores_stand_with_their_own_views(copied):
    light = made(lambda truth, drawn: drawn.mean(axis=(1, 2, 3)), "light")
    score(copied, [light])
    _, values = read_scores(copied, "light")
    sources = open_sources(copied, read_run(copied).manifest, ())
    for record in values[values["method"] == "splat"].to_dict("records"):
        images = sources.images(JobName(*(record[name] for name in JOB)))
        assert images[0].mean() != images[1].mean()
        assert record["value"] == images[record["view"]].mean()


def test_failed_images_are_scored_as_blank_ones(copied):
    """true-mesh fails on one of three objects: it scores 0 where blank scores 1."""
    with open_folder(copied) as store:
        (key, *_) = (row.key for row in store.listed() if row.name.method == "true-mesh")
        store.append(as_failed(store.result(key)))
    blank = made(lambda truth, drawn: (drawn == 255).all(axis=(1, 2, 3)) * 1.0, "is-blank")
    (table,) = score(copied, [blank])
    (row,) = (r for r in rows_of(table) if (r.method, r.condition) == ("true-mesh", "2048"))
    assert (row.value, row.failures_as_blank, row.n_ok, row.n) == (0, 1 / 3, 4, 6)


@pytest.mark.usefixtures("few_objects")
def test_the_worst_images_follow_the_metrics_that_they_are_told_by(copied, command):
    status, out, _ = command("score", copied, "--metrics", "invented-parts")
    assert status == 0
    heads = [line for line in out.splitlines() if line.startswith("# ")]
    assert [head.partition(":")[0] for head in heads] == ["# invented-parts, version 1", "# Tails"]
    shown = out.partition("## Images with an invented part")[2]
    # Noise moves splats off the object; nothing is drawn beside it without.
    splat = next(line for line in shown.splitlines() if line.startswith("| splat |"))
    assert splat == "| splat | 0.0 6/6 | 100.0 6/6 |"


def test_a_taken_name_and_images_that_are_gone_are_refused(copied):
    taken = made(lambda truth, drawn: None, "silhouette-iou")
    with pytest.raises(BadInput, match="metric 'silhouette-iou': the records have a column of"):
        score(copied, [taken])
    damage_images(copied)
    with pytest.raises(BadInput, match="are missing or altered; start the run again"):
        score(copied, [made(lambda truth, drawn: np.ones(len(drawn)))])


@pytest.mark.usefixtures("few_objects")
def test_a_metric_whose_package_is_absent_is_skipped_and_the_others_are_not(copied):
    def absent(*images):
        raise WeightsUnavailable("the package x is not installed; run 'pip install x'")

    ones = made(lambda truth, drawn: np.ones(len(drawn)), "one")
    tables = score(copied, [made(absent), of_set(absent), ones])
    *skipped, measured = (rows_of(table) for table in tables)
    assert {row.metric for rows in skipped for row in rows} == {"made", "fd-made", "fd-made-kernel"}
    for row in (row for rows in skipped for row in rows):
        assert row.note == "skipped: the package x is not installed; run 'pip install x'"
        assert np.isnan(row.value)
    assert {row.value for row in measured} == {1}


@pytest.mark.usefixtures("same_machine")
def test_a_run_takes_metrics_on_request(arguments, copied, command):
    """No job is done again; table, report, output and what the run repeats have the metric."""
    records = (copied / "records.parquet").read_bytes()
    asked = "flip,invented-holes"
    options = ("--metrics", asked, "--format", "csv", "--out", copied)
    status, out, err = command(*arguments, *options)
    assert status == 0, err
    assert "0 jobs done" in err
    assert ",flip,0.000000," in out  # of true-mesh
    assert ",true-mesh,2048,chair,invented-holes,images-percent,0.000000,6,6," in out
    assert {"metric_flip.csv", "tails.csv"} < {path.name for path in (copied / "tables").iterdir()}
    assert read_config(copied / "manifest.json")["metrics"] == asked
    assert (copied / "records.parquet").read_bytes() == records


def of_set(function, id_="fd-made"):
    return SetMetric(id_, function, 3, "made up")


@pytest.mark.usefixtures("few_objects")
def test_distances_of_an_extractor_are_those_of_its_features(copied):
    """The true images are those of the same objects and views."""

    def features(images):
        return np.stack([images.mean(axis=(1, 2, 3)), images.std(axis=(1, 2, 3))], axis=1)

    (table,) = score(copied, [of_set(features)])
    value = {(row.metric, row.method, row.condition): row.value for row in rows_of(table)}
    run = read_run(copied)
    sources = open_sources(copied, run.manifest, ())
    objects = sorted(run.objects(run.image_sets[0]))
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


DARK = made(
    lambda truth, drawn: 100.0 * (drawn < 255).any(axis=3).mean(axis=(1, 2)), "dark-percent"
)


def test_scores_are_kept_for_comparisons_and_the_report(copied, command):
    """Differences are those of the means in its table: no image of this run has failed."""
    (table,) = score(copied, [DARK])
    value = {(row.method, row.condition): row.value for row in rows_of(table)}
    methods = ("--methods", "splat,true-mesh", "--metric", "dark-percent")
    status, out, _ = command("compare", copied, *methods, "--format", "json")
    assert status == 0
    (differences,) = json.loads(out)
    for row in differences["rows"]:
        expected = value["true-mesh", row["condition"]] - value["splat", row["condition"]]
        assert row["difference"] == pytest.approx(expected, abs=1e-12)
    again = make_outputs(read_run(copied))  # of the report
    assert [t.to_csv() for t in again.tables if t.name == table.name] == [table.to_csv()]


def test_scores_of_a_run_that_has_changed_are_refused(copied, capsys):
    """A job that is done again has no score; nor does one whose score was altered."""
    score(copied, [DARK])
    before = read_scores(copied, "dark-percent")[1]
    with open_folder(copied) as store:
        row = next(row for row in store.listed() if row.name.method == "splat")
        result = replace(store.result(row.key), arrays=store.arrays(row.key))
        store.append(result)
    with pytest.raises(BadInput, match="was scored by dark-percent before it was changed; run 'b"):
        read_scores(copied, "dark-percent")
    capsys.readouterr()
    assert further_tables(read_run(copied)) == []
    assert "was scored by dark-percent before it was changed" in capsys.readouterr().err
    score(copied, [DARK])
    assert read_scores(copied, "dark-percent")[1].equals(before)
    for change in ("data = zeroblob(8)", "data = 7"):
        with closing(sqlite3.connect(copied / STORE)) as database, database:
            database.execute(f"UPDATE score SET {change}")
        with pytest.raises(BadInput, match="was scored by dark-percent before it was changed"):
            read_scores(copied, "dark-percent")


def test_a_changed_byte_of_a_score_or_of_its_metric_is_refused_or_changes_nothing(copied):
    """Each stands in its table and in the index; copies in free pages are of no account."""
    score(copied, [DARK])
    metric, before = read_scores(copied, "dark-percent")
    path = copied / STORE
    data = path.read_bytes()
    of_splat = before[before["method"] == "splat"]["value"]  # nothing else has these numbers
    scored = of_splat.to_numpy("<f8")[:2].tobytes()
    for kept, told in (
        (scored, "was scored by dark-percent before it was changed"),
        (metric.about.encode(), "is not scored by dark-percent; run 'bench score "),
    ):
        refusals = []
        for place in (match.start() for match in re.finditer(re.escape(kept), data)):
            changed = bytes([data[place] ^ 1])
            path.write_bytes(data[:place] + changed + data[place + 1 :])
            try:
                _, scores = read_scores(copied, "dark-percent")
            except BadInput as error:
                refusals.append(str(error))
            else:
                assert scores.equals(before)
        assert len(refusals) >= 2
        assert all(told in message for message in refusals)


def test_three_digits_of_the_spread_are_printed():
    """The standard deviations are 10, 0.1, 1e5, 1e-9 and 0."""
    values = ([0.0, 20.0], [0.4, 0.6], [1e5, 3e5], [1e-9, 3e-9], [7.0, 7.0])
    assert [digits_of(np.array([*two, np.nan])) for two in values] == [1, 3, 0, 6, 3]
