"""The headline table: what people see of few objects, and what its CSV has."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
import pytest

from bench.analysis.intervals import mean_interval
from bench.analysis.run import read_run
from bench.commands.terminal import shown
from bench.tables.build import write_outputs
from bench.tables.quality import headline

from ..builders import file_bytes, overwrite, rows_of, write_run, write_run_with_tables


@pytest.mark.parametrize(("count", "intervals"), [(8, False), (11, False), (12, True)])
def test_intervals_are_shown_from_12_objects_on(tmp_path, monkeypatch, count, intervals):
    """Of 8 objects and more there are intervals: in the CSV, and in the other tables."""
    monkeypatch.setenv("COLUMNS", "100")
    objects = [f"chair/{i:02d}" for i in range(count)]
    directory = write_run_with_tables(
        tmp_path / "run", objects=objects, methods=["splat", "blank"], conditions=["2048"]
    )
    table = headline(read_run(directory))
    assert all(low < high for low, high in ((row.ci_low, row.ci_high) for row in rows_of(table)))
    text = "\n".join(shown(table))
    assert "±" not in text
    assert ("[." in text) == ("[95 % interval over objects]" in text) == intervals
    grids = table.to_markdown().partition("## ssim-object")[2]
    assert ("[0." in grids) == intervals
    assert ("Intervals are shown from 12 objects on." in table.to_markdown()) != intervals
    written = pd.read_csv(directory / "tables" / "headline.csv")
    assert written["ci_low"].notna().all()


def test_failed_images_count_as_blank_ones_and_are_named_once(tmp_path):
    """The values are reckoned by hand: one of two objects failed; the interval is over both."""
    objects = [f"chair/{i:02d}" for i in range(8)]
    directory = write_run(tmp_path / "run", objects=objects, methods=["splat", "blank"])
    records = pd.read_parquet(directory / "records.parquet")
    splat, lost = records["method"] == "splat", records["object"] == "00"
    records["ssim_object"] = np.where(splat, 0.8, 0.4)
    failed = {"outcome": "failed", "reason": "timeout: 3 s", "ssim_object": math.nan}
    for column, value in failed.items():
        records.loc[splat & lost, column] = value
    overwrite(directory, records)
    table = headline(read_run(directory))
    rows = [r for r in rows_of(table) if (r.method, r.metric) == ("splat", "ssim-object")]
    scores = np.array([0.4, *[0.8] * 7])
    for row in rows:
        assert row.value == row.failures_as_blank == pytest.approx(scores.mean())
        assert (row.ci_low, row.ci_high) == pytest.approx(mean_interval(scores))
        assert (row.n_ok, row.n) == (14, 16)
    text = table.to_markdown()
    assert text.count("splat at 2048: 2 x timeout: 3 s") == 1
    assert "*b*" not in text


def test_only_tables_of_the_run_itself_are_removed(tmp_path, capsys):
    """A table of a set metric of `bench score` cannot be made again from the records."""
    names = {"suite": "thirteen-classes", "methods": ["splat", "blank"], "conditions": ["2048"]}
    objects = [f"{class_name}/{i}" for class_name in ("chair", "table") for i in range(3)]
    directory = write_run_with_tables(tmp_path / "run", **names, objects=objects)
    folder = directory / "tables"
    for name in ("metric_fd-edges.csv", "metric_fd-edges.md", "notes.md", "mine.csv"):
        (folder / name).write_text("of the user")
    before = file_bytes(folder)
    (folder / "table5_orderings.csv").write_text("of a run with more methods")
    capsys.readouterr()
    write_outputs(read_run(directory))
    assert file_bytes(folder) == before
    assert capsys.readouterr().err == (
        f"removed from {folder}, as no table of the run as it is now: table5_orderings\n"
    )
