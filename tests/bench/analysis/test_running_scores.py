"""Running sums give the rows that all records give."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench.analysis.running_scores import RunningScores
from bench.analysis.scored import score
from bench.analysis.scores import image_rows
from bench.catalogue.lookup import find
from bench.catalogue.suites import SUITES
from bench.records.record import to_frame

from ..builders import make_failed, make_record

SUITE = find("chair-robustness", SUITES, "suite")
METRICS = ("ssim-object", "lpips")
METHODS, CONDITIONS = ["splat", "blank"], ["2048", "512"]
VIEWS = range(3)


def records_of(obj, rng, class_name="chair"):
    """Records of an object: one view of splat fails, another has no ssim-object."""
    records = []
    for condition in CONDITIONS:
        for method in METHODS:
            for view in VIEWS:
                scores = dict(zip(("ssim_object", "lpips"), rng.random(2).tolist(), strict=True))
                made = make_record(method, condition, obj, view, class_name=class_name, **scores)
                if (method, view) == ("splat", int(obj[1:]) % 4):
                    made = make_failed("splat", condition, obj, view, class_name=class_name)
                if (method, view, obj) == ("splat", 2, "o4"):
                    made = replace(made, ssim_object=None)
                records.append(made)
    return records


def test_rows_are_those_of_all_records():
    rng = np.random.default_rng(0)
    objects = [
        *(records_of(f"o{i}", rng) for i in range(9)),
        *(records_of(f"o{i}", rng, "car") for i in range(3)),
    ]
    sums = RunningScores(SUITE.id, METRICS)
    for records in objects:
        sums.add(records)
    assert sums.objects == 12
    actual = sums.rows(METHODS, CONDITIONS, {})
    frame = to_frame([record for records in objects for record in records])
    manifest = {"methods": METHODS, "conditions": CONDITIONS}
    expected = image_rows(score(None, SUITE, manifest, frame, {}), METRICS)
    assert len(actual) == len(expected) == 2 * 2 * 2 * 2
    for row, other in zip(actual, expected, strict=True):
        names = "method", "condition", "class_name", "metric", "n_ok", "n", "note"
        assert [getattr(row.row, n) for n in names] == [getattr(other.row, n) for n in names]
        numbers = "value", "ci_low", "ci_high", "failures_as_blank"
        # sums of 27 numbers up to 1, in another order
        assert [getattr(row.row, n) for n in numbers] == pytest.approx(
            [getattr(other.row, n) for n in numbers], rel=0, abs=1e-12, nan_ok=True
        )
        assert np.sort(row.per_object) == pytest.approx(np.sort(other.per_object), abs=1e-14)
    assert any(row.row.failed for row in actual)


def test_a_metric_that_was_not_measured_says_why():
    sums = RunningScores(SUITE.id, METRICS)
    sums.add([replace(r, lpips=None) for r in records_of("o5", np.random.default_rng(1))])
    assert sums.has_values("ssim-object")
    assert not sums.has_values("lpips")
    rows = sums.rows(METHODS, CONDITIONS, {"lpips": "skipped: no weights"})
    assert {row.row.note for row in rows if row.row.metric == "lpips"} == {"skipped: no weights"}
    assert all(np.isfinite(row.row.value) for row in rows if row.row.metric == "ssim-object")
