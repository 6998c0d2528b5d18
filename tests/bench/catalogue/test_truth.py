from __future__ import annotations

from dataclasses import replace

import pytest

from bench.catalogue.lookup import find
from bench.catalogue.suites import ROBUSTNESS, SUITES
from bench.catalogue.truth import left_out_in_grey, stored_suite, truth_entry, with_truth
from data_prep.failures import BadInput

IN_GREY = find("chair-robustness-grey", SUITES, "suite")
CLASSES = find("thirteen-classes", SUITES, "suite")


def test_the_option_makes_of_chair_robustness_the_suite_in_grey():
    chosen = with_truth(ROBUSTNESS, "grey")
    names = {"id": IN_GREY.id, "about": IN_GREY.about, "methods": IN_GREY.methods}
    assert replace(chosen, **names, truth_chosen=False) == IN_GREY
    assert chosen.id == ROBUSTNESS.id


@pytest.mark.parametrize("suite", SUITES, ids=lambda suite: suite.id)
def test_a_truth_that_is_the_suites_own_changes_nothing(suite):
    assert with_truth(suite, None) is with_truth(suite, suite.truth) is suite
    assert truth_entry(suite) == {}


def test_methods_of_colours_and_the_twin_of_the_ceiling_are_left_out_with_reasons():
    methods = (
        *("splat-net@chair", "splat-net@chair-grey", "true-mesh", "true-mesh@grey"),
        *("constant", "blank"),
    )
    suite = replace(ROBUSTNESS, methods=methods)
    assert left_out_in_grey(suite) == {
        "splat-net@chair": "makes up colours",
        "true-mesh@grey": "is true-mesh in grey",
    }
    assert with_truth(suite, "grey").methods == (
        *("splat-net@chair-grey", "true-mesh", "constant", "blank"),
    )
    alone = replace(ROBUSTNESS, methods=("true-mesh@grey", "blank"))
    assert left_out_in_grey(alone) == {}


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


def test_a_manifest_names_a_truth_that_is_not_the_suites_own():
    chosen = with_truth(CLASSES, "grey")
    assert truth_entry(chosen) == {"truth": "grey"}
    assert stored_suite({"suite": CLASSES.id, "truth": "grey"}) == chosen
    before = [stored_suite({"suite": suite.id}).truth for suite in (CLASSES, IN_GREY)]
    assert before == ["coloured", "grey"]  # of runs from before there was the option


def test_truths_that_there_are_not():
    with pytest.raises(BadInput, match="unknown truth 'gray'"):
        stored_suite({"suite": CLASSES.id, "truth": "gray"})
    with pytest.raises(BadInput, match="--truth coloured: the suite chair-robustness-grey is in"):
        with_truth(IN_GREY, "coloured")
