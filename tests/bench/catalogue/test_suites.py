"""The tables and figures that suites declare, and suites against truth in grey."""

from __future__ import annotations

from dataclasses import replace

import pytest

from bench.catalogue.lookup import find
from bench.catalogue.methods import find_method
from bench.catalogue.suites import (
    DETAIL_TABLE,
    IMAGE_TABLE,
    RECOGNITION_TABLE,
    ROBUSTNESS,
    SET_TABLE,
    SUITES,
    TRUTHS,
    left_out,
    stored_suite,
    truth_entry,
    with_truth,
)

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
    [with_truth(suite, truth) for truth in TRUTHS for suite in SUITES],
    ids=lambda suite: f"{suite.id}, {suite.truth}",
)
def test_each_table_has_metrics_and_a_name_of_its_own(suite):
    assert all(getattr(suite, METRICS[table.kind]) for table in suite.tables)
    assert len({table.name for table in suite.tables}) == len(suite.tables)
    # metrics that no table shows would be measured for nothing; metrics by class use set_metrics'
    shown = {METRICS[table.kind] for table in suite.tables} | {"set_metrics"}
    assert {name for name in METRICS.values() if getattr(suite, name)} <= shown
    assert suite.figures == "robustness" or suite.table(suite.figures)


CLASSES = find("thirteen-classes", SUITES, "suite")


def test_chairs_in_grey_have_the_methods_that_make_up_no_colour_and_networks_in_grey():
    chosen = with_truth(ROBUSTNESS, "grey")
    assert chosen.methods == (
        *("surface-apss", "alpha-wrap", "denoised-wrap", "splat-fill"),
        *("occupancy-net", "splat-net@grey", "fused-net@grey"),
        *("true-mesh", "constant", "blank"),
    )
    assert chosen.set_metrics == ("fd-views-grey", "fd-alexnet", "kd-alexnet")
    assert chosen.tables == (IMAGE_TABLE, SET_TABLE, DETAIL_TABLE, RECOGNITION_TABLE)
    assert chosen.truth == "grey"
    same = ("id", "conditions", "classes", "image_metrics", "detail_metrics", "control_metrics")
    same += ("views", "endless_limit", "limits", "headline")
    assert all(getattr(chosen, name) == getattr(ROBUSTNESS, name) for name in same)


def test_no_method_that_joins_makes_up_colours_and_none_comes_twice():
    for suite in SUITES:
        assert {find_method(m).color for m in suite.grey_methods} <= {"none"}
        methods = with_truth(suite, "grey").methods
        assert len(set(methods)) == len(methods)


def test_methods_of_colours_and_the_twin_of_the_ceiling_are_left_out_with_reasons():
    methods = (
        *("splat-net@chair", "splat-net@grey", "true-mesh", "true-mesh@grey"),
        *("constant", "blank"),
    )
    suite = replace(ROBUSTNESS, methods=methods, grey_methods=())
    assert left_out(suite, "grey") == {
        "splat-net@chair": "makes up colours",
        "true-mesh@grey": "is true-mesh in grey",
    }
    assert with_truth(suite, "grey").methods == (
        *("splat-net@grey", "true-mesh", "constant", "blank"),
    )
    alone = replace(ROBUSTNESS, methods=("true-mesh@grey", "blank"))
    assert left_out(alone, "grey") == {}


def test_metrics_of_colours_have_their_grey_twin_or_none():
    suite = replace(
        CLASSES,
        set_metrics=("fid", "fd-views", "fd-alexnet"),
        class_metrics=("kid", "fd-views", "kd-views", "kd-alexnet", "lpips", "class-confidence"),
    )
    chosen = with_truth(suite, "grey")
    assert chosen.set_metrics == ("fd-views-grey", "fd-alexnet")
    assert chosen.class_metrics == ("fd-views-grey", "kd-alexnet", "lpips")
    costs = with_truth(find("speed-accuracy", SUITES, "suite"), "grey")
    assert costs.frontier[-1] == "fd-views-grey"


def test_no_table_in_grey_is_one_of_the_papers():
    chosen = with_truth(CLASSES, "grey")
    assert [(table.name, table.title) for table in chosen.tables] == [
        ("table_ssim", "SSIM and its components (higher is better)"),
        ("table_classes", "Classes"),
        ("table_detail", "Detail: the object alone, its outline and its thin parts"),
    ]
    assert not any(table.paper_layout for table in chosen.tables)


def test_clouds_with_colours_are_asked_of_methods_in_grey_by_metrics_of_colours():
    """The paper does not ask it. What the missing colour costs is of interest here, too."""
    for suite in SUITES:
        chosen, grey = with_truth(suite, "coloured-clouds"), with_truth(suite, "grey")
        assert chosen.truth == "coloured-clouds"
        assert [m for m in chosen.methods if m != "true-mesh@grey"] == [*grey.methods]
        assert ("true-mesh@grey" in chosen.methods) == ("true-mesh@grey" in suite.methods)
        assert [table.name for table in chosen.tables] == [table.name for table in grey.tables]
        assert chosen.metrics == suite.metrics
        assert stored_suite({"suite": suite.id, "truth": "coloured-clouds"}) == chosen


def test_a_manifest_names_a_truth_in_grey():
    chosen = with_truth(CLASSES, "grey")
    assert truth_entry(chosen) == {"truth": "grey"}
    assert truth_entry(CLASSES) == {}
    assert with_truth(CLASSES, None) is with_truth(CLASSES, "coloured") is CLASSES
    assert stored_suite({"suite": CLASSES.id, "truth": "grey"}) == chosen
    assert stored_suite({"suite": CLASSES.id}) is CLASSES
