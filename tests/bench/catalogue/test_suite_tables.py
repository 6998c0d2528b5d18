"""The tables and figures that suites declare."""

from __future__ import annotations

from dataclasses import replace

import pytest

from bench.catalogue.lookup import find
from bench.catalogue.suites import SUITES
from bench.catalogue.truth import with_truth
from bench.tables.build import make_outputs

from ..builders import make_record, scored_records, to_frame

METRICS = {
    "images": "image_metrics",
    "sets": "set_metrics",
    "classes": "class_metrics",
    "detail": "detail_metrics",
    "recognition": "control_metrics",
    "orderings": "class_metrics",
    "condition sweep": "condition_sweep",
    "frontier": "frontier",
    "points": "frontier",
}


@pytest.mark.parametrize(
    "suite",
    [*SUITES, *(with_truth(suite, "grey") for suite in SUITES)],
    ids=lambda suite: f"{suite.id}, {suite.truth}",
)
def test_each_table_has_metrics_and_a_name_of_its_own(suite):
    assert all(getattr(suite, METRICS[table.kind]) for table in suite.tables)
    assert len({table.name for table in suite.tables}) == len(suite.tables)
    # metrics that no table shows would be measured for nothing; metrics by class use set_metrics'
    shown = {METRICS[table.kind] for table in suite.tables} | {"set_metrics"}
    assert {name for name in METRICS.values() if getattr(suite, name)} <= shown
    assert suite.figures == "robustness" or suite.table(suite.figures)


def test_a_run_has_the_tables_that_its_suite_declares():
    suite = find("speed-accuracy", SUITES, "suite")
    detail = suite.table("detail")
    suite = replace(suite, tables=(replace(detail, name="own_detail", title="Own"),))
    records = to_frame([make_record(method) for method in ("splat", "blank")])
    manifest = {"methods": ["splat", "blank"], "objects": ["chair/a"], "views": 1, "protocol": 1}
    outputs = make_outputs(scored_records(records, suite, **manifest))
    assert [(table.name, table.title) for table in outputs.tables] == [
        ("own_detail", "Own; against the true mesh in its colours; protocol 1")
    ]
    assert (outputs.further, outputs.curves) == ([], ())
