from __future__ import annotations

import math

import numpy as np
import pytest

from bench.analysis.compare import Estimate
from bench.analysis.intervals import jackknife_error, jackknife_interval, mean_interval
from bench.analysis.paper import orderings, verdict_of
from bench.analysis.sets import FeatureDistances
from bench.catalogue.lookup import find
from bench.catalogue.suites import SUITES
from bench.metrics.frechet import JackknifeMoments, left_out_distances
from bench.records.job import GROUND_TRUTH
from bench.tables.paper import published

from ..builders import FeaturesAtHand, feature_index, make_record, scored_records, to_frame

pytestmark = pytest.mark.usefixtures("few_objects")

SUITE = find("thirteen-classes", SUITES, "suite")
PAPER = published("thirteen-classes")
OBJECTS = ("a", "b", "c", "d")
# SSIM of the network is ahead of SR's by so much in each object
LEADS = {"car": (0.10, 0.12, 0.09, 0.11), "lamp": (0.05, 0.02, 0.04, 0.03), "vessel": (0, 0, 1, -1)}


def records():
    made = []
    for k, leads in LEADS.items():
        for i, (obj, ahead) in enumerate(zip(OBJECTS, leads, strict=True)):
            sr = 0.5 + 0.1 * i
            values = {"surface-apss": sr, "pc2pix@all": sr + ahead, "blank": 0.2}
            made += [
                make_record(method, obj=obj, view=v, class_name=k, ssim=value + 0.01 * v)
                for method, value in values.items()
                for v in (0, 1)
            ]
    return to_frame(made)


def of_run(frame=None, features=None):
    run = scored_records(records() if frame is None else frame, SUITE, features)
    return orderings(run, PAPER)


def row(made, class_name, metric="ssim"):
    (found,) = made[(made["class"] == class_name) & (made["metric"] == metric)].itertuples()
    return found


def interval(found):
    return found.ci_low, found.ci_high


def test_a_lead_is_paired_over_objects():
    made = of_run()
    found = row(made, "car")
    assert found.lead == pytest.approx(0.105, abs=1e-12)
    # differences of numbers near 0.6
    expected = mean_interval(np.array(LEADS["car"]), alpha=0.05 / 3)  # of three classes
    assert interval(found) == pytest.approx(expected, abs=1e-12)
    assert found.surface == pytest.approx(0.5 + 0.15 + 0.005, abs=1e-12)
    assert found.network == pytest.approx(found.surface + 0.105, abs=1e-12)
    assert found.objects == 4
    assert found.verdict == "reproduced"  # the paper: pc2pix, by 163.1
    assert row(made, "lamp").verdict == "opposite"  # the paper: SR, by 60.5
    assert row(made, "vessel").verdict == "undecided"


@pytest.mark.parametrize(
    ("difference", "paper", "verdict"),
    [
        ((1, 0.5, 1.5), 3.0, "reproduced"),
        ((1, 0.5, 1.5), -3.0, "opposite"),
        ((-1, -1.5, -0.5), -3.0, "reproduced"),
        ((-1, -1.5, -0.5), 3.0, "opposite"),
        ((1, -0.1, 2.1), 3.0, "undecided"),
        ((1, 0.0, 2.0), 3.0, "undecided"),
        ((1, math.nan, math.nan), 3.0, "undecided"),
        ((math.nan, math.nan, math.nan), 3.0, "no value"),
        ((1, 0.5, 1.5), math.nan, "no value"),
    ],
)
def test_rules_of_a_verdict(difference, paper, verdict):
    assert verdict_of(Estimate(*difference), paper) == verdict


def test_the_average():
    made = of_run()
    found = row(made, "average")
    assert found.lead == pytest.approx((0.105 + 0.035 + 0) / 3, abs=1e-12)
    differences = [np.array(LEADS[k], float) for k in ("car", "lamp", "vessel")]
    assert interval(found) == pytest.approx(mean_interval(*differences), abs=1e-12)
    assert found.paper_lead == pytest.approx(57.2, abs=1e-9)
    assert found.objects == 12


def test_an_object_without_a_value_leaves_the_average_an_interval():
    without = records()
    without.loc[(without["class"] == "lamp") & (without["object"] == "a"), "ssim"] = math.nan
    found = row(of_run(without), "average")
    differences = [np.array(LEADS[k][k == "lamp" :], float) for k in ("car", "lamp", "vessel")]
    value = np.mean([values.mean() for values in differences])
    assert found.lead == pytest.approx(value, abs=1e-12)
    assert interval(found) == pytest.approx(mean_interval(*differences), abs=1e-12)


def test_the_average_is_of_the_classes_in_which_both_have_a_value():
    without = records()
    lost = (without["class"] == "lamp") & (without["method"] == "surface-apss")
    without.loc[lost, "ssim"] = math.nan
    found = row(of_run(without), "average")
    assert found.lead == pytest.approx((0.105 + 0) / 2, abs=1e-12)
    assert (found.surface, found.network) == pytest.approx((0.655, 0.655 + 0.0525), abs=1e-12)


def test_distances_are_ahead_where_they_are_smaller():
    frame = feature_index(("surface-apss", "pc2pix@all", "blank"), dict.fromkeys(LEADS, OBJECTS))
    values = np.random.default_rng(0).random((len(frame), 3), np.float32)
    values[frame["method"] == "surface-apss"] += 2.0
    made = of_run(features={"fd-views": FeatureDistances(FeaturesAtHand(frame, values))})
    every = []
    for k in LEADS:
        truth, surface, network = (
            JackknifeMoments(
                values[(frame["method"] == m) & (frame["class"] == k)], np.repeat(OBJECTS, 2)
            )
            for m in (GROUND_TRUTH, "surface-apss", "pc2pix@all")
        )
        every.append(left_out_distances(network, truth) - left_out_distances(surface, truth))
        found = row(made, k, "fd-views")
        assert found.lead == pytest.approx(found.surface - found.network, rel=1e-12)
        assert found.lead > 5  # 3 features off by 2 each: 12, less what chance gives
        expected = jackknife_error([-every[-1]]).interval(found.lead, 0.05 / 3)
        assert interval(found) == pytest.approx(expected, rel=1e-9)
    average = row(made, "average", "fd-views")
    value = np.mean([row(made, k, "fd-views").lead for k in LEADS])
    assert average.lead == pytest.approx(value, rel=1e-12)
    assert interval(average) == pytest.approx(jackknife_interval(value, every), rel=1e-9)


@pytest.mark.parametrize("gone", ["surface-apss", "pc2pix@all"])
def test_both_sides_are_needed(gone):
    frame = records()
    assert of_run(frame[frame["method"] != gone]).empty
