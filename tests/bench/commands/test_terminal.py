"""The progress of a run on a terminal and elsewhere, with a small table."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import pytest

from bench.catalogue.suites import TableSpec
from bench.commands.terminal import MOST_LINES, SHARE, LiveTable, Terminal, shown
from bench.records.frames import job_frame
from bench.running.run import PartialRun

from ..builders import SUITE, make_record, results_of, rows_of, to_frame, value_row, value_table


def make_row(method="splat", value=0.5, condition="2048"):
    return value_row(method, value, condition, ci_low=0.4, ci_high=0.6)


def table(objects):
    rows = [make_row("splat", value=0.5 + objects / 100), make_row("blank", value=0.25)]
    title = f"ssim: {objects} of 9 objects"
    return value_table(*rows, spec=TableSpec("images", "headline", title))


def snapshot(objects):
    return lambda: PartialRun(Path("run"), {"objects": ["a"] * objects}, [], list)


def test_elsewhere_one_line_names_the_file(clock, capsys):
    with Terminal(lambda part: table(len(part.manifest["objects"])), "items", 4) as terminal:
        terminal.on_jobs_done(1, 0)
        terminal.on_object_done(snapshot(1))
        terminal.on_jobs_done(2, 1)  # two are done: one had nothing to be scored against
        terminal.on_object_done(snapshot(2))
        clock[0] += 20
        terminal.on_jobs_done(1, 1)
    out, err = capsys.readouterr()
    assert out == ""
    assert err.splitlines() == [
        "headline table so far: run/tables/headline.md",
        "items: 4/4 done, 1 failed, 20 s, about 0 s left",
    ]


def test_tables_in_between_take_little_of_the_time(clock):
    made = []

    def make(part):
        made.append(clock[0])
        clock[0] += 3
        return table(1)

    with Terminal(make, "items", 100) as terminal:
        for _ in range(400):
            clock[0] += 1
            terminal.on_object_done(snapshot(1))
    waits = [later - before - 3 for before, later in pairwise(made)]
    assert made[0] == 101
    assert waits == [3 / SHARE] * len(waits)
    assert len(waits) > 1


@pytest.mark.parametrize(("terminal", "live"), [("xterm", True), ("dumb", False)])
def test_on_a_terminal_the_table_is_drawn(monkeypatch, capsys, terminal, live):
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    monkeypatch.setenv("TERM", terminal)
    with Terminal(lambda part: table(1), "items", 2) as view:
        view.on_jobs_done(1, 0)
        view.on_object_done(snapshot(1))
        view.on_jobs_done(1, 0)
    out, err = capsys.readouterr()
    assert out == ""
    assert ("ssim: 1 of 9 objects" in err) == live
    assert ("0.510" in err) == live
    assert ("headline table so far" in err) == (not live)


@pytest.mark.slow
def test_no_wider_and_longer_than_the_terminal(monkeypatch):
    rows = [make_row(f"method-{i}", condition=f"c-{j}") for i in range(50) for j in range(3)]
    made = value_table(*rows, spec=TableSpec("images", "headline", "ssim: 1 of 9 objects"))
    for columns, width in ((20, 20), (60, 60), (100, 100), (500, 100)):
        monkeypatch.setenv("COLUMNS", str(columns))
        lines = shown(made)
        assert len(lines) == MOST_LINES
        assert max(map(len, lines)) <= width


SCORES = {"splat-net": 0.9, "alpha-wrap": 0.5, "blank": 0.2}
ORDER = [f"chair/o{i:02d}" for i in range(40)]


class Part:
    """A part of a run (`bench.running.run.PartialRun`) whose lpips was not measured."""

    names = ORDER

    def __init__(self, directory, objects):
        self.directory, self.plan = directory, self
        self.manifest = {
            "suite": SUITE,
            "methods": list(SCORES),
            "conditions": ["2048"],
            "objects": list(objects),
            "planned": len(ORDER),
            "protocol": 2,
            "skipped_metrics": {"fd-alexnet": "skipped: no weights"},
        }

    def read_jobs(self, name):
        name = name.partition("/")[2]
        records = [
            make_record(method, obj=name, ssim_object=score, lpips=None)
            for method, score in SCORES.items()
        ]
        return job_frame(results_of(to_frame(records)))


def test_the_table_is_written_and_says_which_intervals_it_has(tmp_path):
    live = LiveTable()
    few = live.table(Part(tmp_path, ORDER[10:15]))
    assert {row.n for row in rows_of(few) if row.metric == "ssim-object"} == {5}
    table = live.table(Part(tmp_path, ORDER[:30]))  # objects are added once
    rows = {(row.method, row.metric): row for row in rows_of(table)}
    assert rows["splat-net", "ssim-object"].value == pytest.approx(0.9, abs=1e-12)
    assert rows["splat-net", "ssim-object"].n == 30
    assert rows["blank", "lpips"].note == "skipped: no weights"
    written = {path.name for path in (tmp_path / "tables").iterdir()}
    assert written == {"headline.csv", "headline.md"}
