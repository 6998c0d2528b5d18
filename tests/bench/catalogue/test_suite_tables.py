"""The tables and figures that suites declare."""

from __future__ import annotations

import pytest

from bench.catalogue.suites import SUITES, with_truth

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
