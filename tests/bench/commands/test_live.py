"""Live tables: objects come in any order, and pairs are decided in that of their start."""

from __future__ import annotations

import pytest
from harness_objects import Tetrahedron

from bench.catalogue.lookup import find
from bench.catalogue.suites import SUITES
from bench.commands.live import LiveTable
from bench.running.options import UNTIL_DECIDED
from bench.running.plan import ObjectJobs
from data_prep.failures import BadInput

from ..builders import make_record, make_truth

SUITE = find("chair-robustness", SUITES, "suite")
METHODS, CONDITIONS = ["splat-net", "alpha-wrap", "blank"], ["2048"]
SCORES = {"splat-net": 0.9, "splat": 0.7, "alpha-wrap": 0.5, "blank": 0.2}
ORDER = [f"chair/o{i:02d}" for i in range(40)]


def manifest(objects, methods=METHODS, **more):
    return {
        "suite": SUITE.id,
        "methods": methods,
        "conditions": CONDITIONS,
        "objects": list(objects),
        "planned": len(ORDER),
        "protocol": 2,
        "skipped_metrics": {"fd-alexnet": "skipped: no weights"},
        **more,
    }


class Part:
    """A part of a run (`bench.running.listeners.PartialRun`) whose lpips was not measured."""

    def __init__(self, directory, objects, methods=METHODS):
        self.directory, self.manifest, self.plan = directory, manifest(objects, methods), self
        self.names = list(objects)

    def select(self, names):
        return [ObjectJobs(make_truth(Tetrahedron(name.partition("/")[2])), ()) for name in names]

    def read_records(self, obj):
        name = obj.name.partition("/")[2]
        return [
            make_record(m, obj=name, ssim_object=SCORES[m], lpips=None)
            for m in self.manifest["methods"]
        ]


def test_pairs_wait_for_objects_that_were_begun_earlier(tmp_path):
    live = LiveTable()
    live.begin(manifest(ORDER, **{UNTIL_DECIDED: True}), ORDER)
    live.add_missing(Part(tmp_path, ORDER[1:]))
    assert not live.enough()  # the first is not complete
    live.add_missing(Part(tmp_path, ORDER))
    assert live.enough()
    undecided = LiveTable()
    undecided.begin(manifest(ORDER), ORDER)
    undecided.add_missing(Part(tmp_path, ORDER))
    assert not undecided.enough()  # no one asked for an end


def test_tables_are_written_and_say_which_intervals_they_have(tmp_path):
    live = LiveTable()
    live.begin(manifest(ORDER), ORDER)
    live.add_missing(Part(tmp_path, ORDER[:5]))
    table = live.table(Part(tmp_path, ORDER[:30]))  # objects are added once
    rows = {(row.method, row.metric): row for row in table.rows}
    assert rows["splat-net", "ssim-object"].value == pytest.approx(0.9, abs=1e-12)
    assert rows["splat-net", "ssim-object"].n == 30
    assert rows["blank", "lpips"].note == "skipped: no weights"
    text = (tmp_path / "tables" / "headline.md").read_text()
    assert "Intervals hold for a number of objects that was fixed beforehand" in text
    decided = (tmp_path / "tables" / "decided.md").read_text()
    assert decided.startswith("# 1 of 1 headline pairs decided: 30 of 40 objects")
    assert "they hold together, at 95 %, however often one looks" in decided
    assert "| splat-net | 0.400 ahead (" in decided


def test_a_run_without_pairs_has_a_headline_alone(tmp_path):
    live = LiveTable()
    live.begin(manifest(ORDER, ["splat", "blank"]), ORDER)
    live.table(Part(tmp_path, ORDER[:3], ["splat", "blank"]))
    assert sorted(p.name for p in (tmp_path / "tables").iterdir()) == [
        "headline.csv",
        "headline.md",
    ]
    with pytest.raises(BadInput, match="--until-decided: splat, blank have no pair to decide"):
        live.begin(manifest(ORDER, ["splat", "blank"], **{UNTIL_DECIDED: True}), ORDER)
