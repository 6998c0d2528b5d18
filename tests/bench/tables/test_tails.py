"""The table of tails of made-up scores, whose worst images and shares are reckoned by hand."""

from __future__ import annotations

import csv
import io
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from bench.analysis.run import read_run
from bench.analysis.tails import TAIL_COLUMNS, tail_rows
from bench.records.folder import open_folder
from bench.records.store import ScoredMetric
from bench.report.build import write_report
from bench.tables.build import make_outputs, tails, write_outputs, write_tails
from data_prep.datasets.protocol_version import PROTOCOL_VERSION

from ..builders import make_failed, read_all, write_all, write_run

OBJECTS = ("chair/a", "chair/b", "table/c")
HOLES, PARTS = "invented-holes", "invented-parts"
# By method: of each object and view. `splat` fails on chair/b, where its values, -1, are not kept.
VALUES = {
    "lpips": {
        "splat": ((0.1, 0.2), (-1, -1), (0.3, 0.5)),
        "true-mesh": ((0, 0), (0, 0), (0, 0)),
        "blank": ((0.6, 0.6), (0.6, 0.75), (0.6, 0.6)),
    },
    HOLES: {
        "splat": ((0, 25), (-1, -1), (0, 0)),
        "true-mesh": ((0, 0), (0, 0), (0, 0)),
        "blank": ((300, 300), (310, 300), (0, 20)),
    },
    PARTS: {
        "splat": ((0, 0), (-1, -1), (40, 0)),
        "true-mesh": ((0, 0), (0, 0), (0, 0)),
        "blank": ((0, 0), (0, 0), (0, 0)),
    },
}
LATE = "timeout: 3 s"


def value(metric, method, class_name, obj, view):
    return float(VALUES[metric][method][OBJECTS.index(f"{class_name}/{obj}")][view])


def scored_run(directory, *metrics):
    """A run at 2048 points and at 512, with the same values, that is scored by metrics."""
    methods = ["splat", "true-mesh", "blank"]
    write_run(directory, objects=[*OBJECTS], methods=methods, suite="thirteen-classes")
    records = []
    for record in read_all(directory):
        cell = record.method, record.condition, record.object, record.view
        lpips = value("lpips", record.method, record.class_name, record.object, record.view)
        common = {"class_name": record.class_name, "suite": record.suite}
        if record.method == "splat" and record.object == "b":
            records.append(make_failed(*cell, LATE, **common))
        else:
            records.append(replace(record, lpips=lpips))
    write_all(directory, records)
    with open_folder(directory) as store:
        jobs = {row.key: row.name for row in store.listed() if row.has_images}
        for metric in metrics:
            scores = {
                key: np.array([value(metric, method, *of_object, view) for view in (0, 1)])
                for key, (method, _, *of_object) in jobs.items()
                if method in VALUES[metric]
            }
            store.put_scores(ScoredMetric(metric, 1, "made up", False, 1), scores)
    return directory


@pytest.fixture(scope="module")
def scored(tmp_path_factory):
    return scored_run(tmp_path_factory.mktemp("tails") / "run", HOLES, PARTS)


LINES = [  # of the CSV at 2048: of six images one is the worst of a hundredth
    "splat,lpips,worst-1-percent,0.750000,4,6,0.750000,chair/b,1",
    "true-mesh,lpips,worst-1-percent,0.000000,6,6,0.000000,,",
    "blank,lpips,worst-1-percent,0.750000,6,6,0.750000,chair/b,1",
    "splat,invented-holes,images-percent,50.000000,4,6,310.000000,chair/b,0",
    "true-mesh,invented-holes,images-percent,0.000000,6,6,0.000000,,",
    "blank,invented-holes,images-percent,83.333333,6,6,310.000000,chair/b,0",
    "splat,invented-parts,images-percent,16.666667,4,6,40.000000,table/c,0",
    "true-mesh,invented-parts,images-percent,0.000000,6,6,0.000000,,",
    "blank,invented-parts,images-percent,0.000000,6,6,0.000000,,",
]


def test_values_and_worst_images(scored):
    """A failed image is a blank one: splat has three of six images with a hole, two of them so."""
    rows = csv.DictReader(io.StringIO(tails(read_run(scored)).to_csv()))
    assert rows.fieldnames == [*TAIL_COLUMNS, "protocol"]
    at_2048 = [row for row in rows if row["condition"] == "2048"]
    common = {"suite": "thirteen-classes", "class": "all", "protocol": str(PROTOCOL_VERSION)}
    assert all(row.items() >= common.items() for row in at_2048)
    told = [name for name in TAIL_COLUMNS if name not in (*common, "condition")]
    assert [",".join(row[name] for name in told) for row in at_2048] == LINES


def test_what_people_see(scored):
    text = tails(read_run(scored)).to_markdown()
    headings = [line for line in text.splitlines() if line.startswith("#")]
    assert headings == [
        "# Tails: the worst images of each method; against the true mesh in its colours; "
        f"protocol {PROTOCOL_VERSION}",
        "## Mean lpips of the worst 1 % of the images",
        "## The image with the highest lpips",
        "## Images with an invented hole, in per cent",
        "## The image with the most pixels of invented holes",
        "## Images with an invented part, in per cent",
        "## The image with the most pixels of invented parts",
    ]
    lines = text.splitlines()
    assert "Failed images are scored as blank ones" in lines[2]
    for method, cells in {
        "splat": ("50.0 4/6", "chair/b, view 0: 310 px", "chair/b, view 1: 0.750"),
        "true-mesh": ("0.000 6/6", "0.0 6/6", "none"),
        "blank": ("83.3 6/6", "chair/b, view 0: 310 px", "chair/b, view 1: 0.750"),
    }.items():
        for cell in cells:
            assert f"| {method} | {cell} | {cell} |" in lines
    assert lines.count("* splat at 2048: 4 of 6 images, the others scored as blank") == 3


def test_the_report_shows_the_table(scored, tmp_path):
    text = write_report(make_outputs(read_run(scored)), tmp_path / "a.html").read_text("utf-8")
    assert "<span>images with an invented hole, in per cent</span>" in text
    assert "chair/b, view 0: 310 px" in text


@pytest.mark.parametrize(
    ("count", "expected"), [(1, 1.0), (100, 100.0), (101, 100.5), (200, 199.5), (201, 200.0)]
)
def test_the_worst_hundredth_is_rounded_up(count, expected):
    """The values are 1 to `count` in another order: the mean is of the largest one to three."""
    values = np.random.default_rng(0).permutation(count) + 1.0
    images = pd.DataFrame(
        {"method": "splat", "condition": "2048", "class": "chair", "object": "a"}
        | {"view": np.arange(count), "outcome": "ok", "lpips": values}
    )
    (row,) = tail_rows(images, "s").to_dict("records")
    assert (row["value"], row["worst"], row["class"]) == (expected, count, "chair")
    assert row["worst_view"] == str(values.argmax())


def test_there_is_a_table_of_what_the_run_was_scored_by(tmp_path):
    """Without either there is none, and one of scores that have changed since is removed."""
    run = scored_run(tmp_path / "run")
    files = [run / "tables" / f"tails.{kind}" for kind in ("csv", "md")]
    assert write_tails(read_run(run)) is None
    assert not any(path.exists() for path in files)
    run = scored_run(tmp_path / "parts", PARTS)
    table = write_tails(read_run(run))
    assert [*table.frame["metric"].unique()] == ["lpips", PARTS]
    files = [run / "tables" / f"tails.{kind}" for kind in ("csv", "md")]
    assert [path.read_text("utf-8") for path in files] == [table.to_csv(), table.to_markdown()]
    write_all(run, read_all(run))
    assert write_outputs(read_run(run)).tails is None
    assert not any(path.exists() for path in files)
