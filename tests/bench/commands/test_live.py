"""The live table: objects come in parts, and each is added once."""

from __future__ import annotations

import pytest

from bench.catalogue.lookup import find
from bench.catalogue.suites import SUITES
from bench.commands.live import LiveTable

from ..builders import make_record, rows_of, to_frame

SUITE = find("chair-robustness", SUITES, "suite")
SCORES = {"splat-net": 0.9, "alpha-wrap": 0.5, "blank": 0.2}
ORDER = [f"chair/o{i:02d}" for i in range(40)]


class Part:
    """A part of a run (`bench.running.run.PartialRun`) whose lpips was not measured."""

    names = ORDER

    def __init__(self, directory, objects):
        self.directory, self.plan = directory, self
        self.manifest = {
            "suite": SUITE.id,
            "methods": list(SCORES),
            "conditions": ["2048"],
            "objects": list(objects),
            "planned": len(ORDER),
            "protocol": 2,
            "skipped_metrics": {"fd-alexnet": "skipped: no weights"},
        }

    def read_records(self, name):
        name = name.partition("/")[2]
        return to_frame(
            make_record(method, obj=name, ssim_object=score, lpips=None)
            for method, score in SCORES.items()
        )


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
