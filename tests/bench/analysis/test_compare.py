from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.stats import t as student

from bench.analysis.compare import (
    ALL,
    NAN,
    OVERALL,
    VALUE,
    best_first,
    candidates,
    compare,
    over_conditions,
    pooled,
    with_costs,
)
from bench.analysis.differences import better_by, change
from bench.analysis.intervals import clipped, mean_interval, median_interval
from bench.analysis.sets import FeatureDistances
from bench.analysis.values import image_rows
from bench.catalogue.metrics import IMAGE_METRICS, metric_facts, value_range
from bench.catalogue.metrics import column as column_of
from bench.metrics.frechet import frechet_distance
from bench.records.job import GROUND_TRUTH

from ..builders import (
    FeaturesAtHand,
    feature_index,
    make_failed,
    make_record,
    scored_records,
    to_frame,
)
from .comparisons import comparison, row_of

pytestmark = pytest.mark.usefixtures("few_objects")

# Seconds to prepare and to draw a view, and the ssim of two views, of each object.
SPLAT = {
    "a": (0.010, 0.001, (0.5, 0.7)),
    "b": (0.030, 0.002, (0.9, 0.9)),
    "c": (0.020, 0.009, (0.3, 0.1)),
}
METHODS = ("splat", "blank")
BLANK = {"a": (0.4, 0.6), "b": (0.5, 0.5), "c": (0.2, 0.6)}


def records(failed=(), **times_of_failures):
    """splat and blank on three objects; splat failed on those."""
    made = [
        make_record("blank", obj=obj, view=view, ssim=ssim, prepare_s=0.0, draw_s=0.0)
        for obj, scores in BLANK.items()
        for view, ssim in enumerate(scores)
    ]
    for obj, (prepare_s, draw_s, scores) in SPLAT.items():
        for view, ssim in enumerate(scores):
            if obj in failed:
                made.append(make_failed("splat", obj=obj, view=view, **times_of_failures))
            else:
                times: dict[str, Any] = {"prepare_s": prepare_s, "draw_s": draw_s}
                made.append(make_record("splat", obj=obj, view=view, ssim=ssim, **times))
    return made


def of_splat(frame, views=20):
    compared = compare(scored_records(frame), ["ssim"])
    return row_of(with_costs(compared, views), method="splat")


# c draws so slowly that it is the most expensive by 20 views
@pytest.mark.parametrize(("views", "cost_ms"), [(1, (11.0, 32.0, 29.0)), (20, (30.0, 70.0, 200.0))])
def test_cost_is_the_median_over_clouds(views, cost_ms):
    row = of_splat(to_frame(records()), views)
    assert row["cost_ms"] == pytest.approx(np.median(cost_ms), rel=1e-12)  # two roundings
    expected = median_interval(np.array(cost_ms), np.arange(3))
    assert (row["cost_ci_low"], row["cost_ci_high"]) == pytest.approx(expected, rel=1e-12)


def test_a_cloud_that_failed_costs_the_time_that_it_took():
    """Older records do not have the time of a failed cloud."""
    taken = {"prepare_s": 0.5, "draw_s": 0.0}
    for failed, times, cost_ms in [
        ("c", taken, (30.0, 70.0, 500.0)),
        ("ab", taken, (500.0, 500.0, 200.0)),
        ("c", {}, (30.0, 70.0)),
    ]:
        row = of_splat(to_frame(records(failed, **times)))
        assert row["cost_ms"] == pytest.approx(np.median(cost_ms), rel=1e-12)
        assert (row["n_ok"], row["n"]) == (6 - 2 * len(failed), 6)
    never = of_splat(to_frame(records("abc", **taken)))
    assert np.isnan([never["cost_ms"], never["cost_ci_low"], never["cost_ci_high"]]).all()
    assert (never["n_ok"], never["n"]) == (0, 6)


def test_scores_are_means_over_objects_with_blanks_for_failures():
    whole = of_splat(to_frame(records()))
    np.testing.assert_allclose(whole["samples"], [0.6, 0.9, 0.2], atol=1e-15)
    assert whole["value"] == pytest.approx(1.7 / 3, abs=1e-15)
    interval = clipped(mean_interval(np.array([0.6, 0.9, 0.2])), (-1.0, 1.0))
    np.testing.assert_allclose((whole["ci_low"], whole["ci_high"]), interval)
    lost = of_splat(to_frame(records(failed="b")))
    np.testing.assert_allclose(lost["samples"], [0.6, 0.5, 0.2], atol=1e-15)


def test_objects_without_true_images_are_left_out():
    lost = [make_failed(m, obj="d", reason="input: no faces") for m in ("splat", "blank")]
    row = of_splat(to_frame([*records(), *lost]))
    assert row["objects"] == ("a", "b", "c")
    assert (row["n_ok"], row["n"]) == (6, 7)
    assert compare(scored_records(to_frame(lost)), ["ssim"]).empty


def test_who_could_be_chosen():
    methods = ["splat", "true-mesh", "pc2pix@gone.safetensors", "constant", "poisson", "blank"]
    assert candidates(methods) == ["splat", "pc2pix@gone.safetensors", "poisson"]


OBJECTS, VIEWS, WIDTH = "abcde", 2, 3
RNG = np.random.default_rng(0)
FEATURES = {
    name: RNG.normal(scale=scale, size=(len(OBJECTS) * VIEWS, WIDTH)).astype(np.float32)
    for name, scale in ((GROUND_TRUTH, 1.0), ("splat", 2.0), ("poisson", 2.5), ("blank", 0.1))
}
SHOWN = np.repeat(list(OBJECTS), VIEWS)


def features(without=""):
    """The features above, splat's without those objects."""
    index = feature_index(list(FEATURES)[1:], {"chair": OBJECTS})
    kept = (index["method"] != "splat") | ~index["object"].isin([*without])
    return FeaturesAtHand(index[kept], np.concatenate([*FEATURES.values()])[kept])


def distances(without="", objects=OBJECTS):
    made = [
        make_failed("splat", obj=obj, view=view)
        if method == "splat" and obj in without
        else make_record(method, obj=obj, view=view)
        for method in ("splat", "poisson", "blank")
        for obj in objects
        for view in range(VIEWS)
    ]
    at_hand: Any = features(without)
    measured = {"fd-views": FeatureDistances(at_hand)}
    compared = compare(scored_records(to_frame(made), features=measured), ["fd-views"])
    return {row["method"]: row for row in compared.to_dict("records")}


def test_the_distance_of_failed_images_is_that_of_blank_ones():
    mixed = np.where((SHOWN == "c")[:, None], FEATURES["blank"], FEATURES["splat"])
    found = distances(without="c")["splat"]["value"]
    assert found == frechet_distance(mixed, FEATURES[GROUND_TRUTH])
    none = distances(without=OBJECTS)
    assert [none["splat"][name] for name in VALUE] == [none["blank"][name] for name in VALUE]


def test_a_lead_in_distance_is_the_jackknife_of_the_difference():
    a, b = (distances()[method] for method in ("splat", "poisson"))
    found = better_by([a], [b]).estimate()

    def difference(rows):
        truth, splat, poisson = (
            FEATURES[name][rows] for name in (GROUND_TRUTH, "splat", "poisson")
        )
        return frechet_distance(poisson, truth) - frechet_distance(splat, truth)

    without = np.array([difference(obj != SHOWN) for obj in OBJECTS])
    # Efron and Stein 1981, as the standard deviation of the pseudo-values
    pseudo = 5 * difference(SHOWN != "") - 4 * without
    reach = student.ppf(0.975, 4) * pseudo.std(ddof=1) / np.sqrt(5)
    assert found.value == pytest.approx(b["value"] - a["value"], abs=1e-12)
    ends = (found.value - reach, found.value + reach)
    assert (found.low, found.high) == pytest.approx(ends, abs=1e-9)
    assert better_by([b], [a]).value == -found.value


def scores(metric, **of_methods):
    """Rows of methods with these scores of each object."""
    return comparison({m.replace("_", "-"): (0, 0, v) for m, v in of_methods.items()}, metric)


def test_digits_that_are_not_printed_order_nothing():
    """Rivals are compared with surface-apss in its two decimals of lpips."""

    def places(metric, **values):
        ordered = best_first(scores(metric, **{m: [v] for m, v in values.items()}))
        return dict(zip(ordered["method"], ordered["before"], strict=True))

    assert places("ssim", a=0.81449, b=0.8136, c=0.8146) == {"c": 0, "a": 1, "b": 1}
    assert places("fd-views", a=4.62, b=4.58, c=NAN) == {"a": 0, "b": 0}
    coarse = places("lpips", splat=0.234, surface_apss=0.231, pc2pix=0.226)
    assert coarse == {"pc2pix": 0, "surface-apss": 0, "splat": 1}


def test_classes_are_pooled_object_by_object():
    chairs = comparison({"splat": (1.0, 2.0, (0.5, 0.7)), "blank": (0, 0, (0.1, 0.2))})
    sofas = comparison({"splat": (3.0, 4.0, (0.9,)), "blank": (0, 0, (0.6,))}, class_name="sofa")
    noisy = comparison({"splat": (1.0, 2.0, (0.5,)), "blank": (0, 0, (0.1,))}, condition="512")
    together = with_costs(pooled(pd.concat([chairs, noisy, sofas])), 10)
    alone = row_of(together, condition="512", method="splat")
    assert alone["objects"] == ("chair/a",)  # the sofa has no true image
    splat = row_of(together, condition="2048", method="splat")
    assert (splat["class"], splat["objects"]) == (ALL, ("chair/a", "chair/b", "sofa/a"))
    assert splat["samples"].tolist() == [0.5, 0.7, 0.9]
    interval = clipped(mean_interval(splat["samples"]), (-1.0, 1.0))
    assert [splat[name] for name in VALUE] == [pytest.approx(0.7), *interval]
    assert splat["cost_ms"] == 21.0  # of 21, 21 and 43
    assert (splat["n_ok"], splat["n"]) == (6, 6)
    assert pooled(chairs).empty


def test_the_mean_over_conditions_is_of_objects_that_all_have():
    full = {
        "m": (10, 10, (0.1, 0.2, 0.3)),
        "blank": (0, 0, (0.9, 0.9, 0.9)),
        "once": (0, 0, [1] * 3),
    }
    few = {"m": (20, 20, (0.3, 0.6)), "blank": (0, 0, (0.9, 0.9))}
    both = pd.concat([comparison(full, "lpips"), comparison(few, "lpips", condition="512")])
    overall = with_costs(over_conditions(both), 1)
    assert overall["method"].tolist() == ["m", "blank"]  # one has a single condition
    row = row_of(overall, method="m")
    assert (row["condition"], row["objects"]) == (OVERALL, ("a", "b"))
    assert row["samples"] == pytest.approx([0.2, 0.4])
    assert (row["value"], row["n_ok"], row["n"]) == (pytest.approx(0.3), 10, 10)
    assert row["cost_ms"] == pytest.approx(20)  # of the first condition


def test_no_difference_is_larger_than_the_range_of_its_metric():
    """Seven of eight objects differ by the whole range of an IoU: Student's interval exceeds it."""
    ones, a = np.ones(8), np.array([0.0] * 7 + [0.9])

    def difference(metric, factor=1):
        pair = scores(metric, x=factor * ones, y=factor * a).to_dict("records")
        return change(pair[:1], pair[1:]).estimate()

    assert mean_interval(ones - a)[1] > 1
    found = difference("silhouette-iou")
    assert found == (pytest.approx(0.8875), mean_interval(ones - a)[0], 1.0)
    assert difference("psnr", 30)[1:] == mean_interval(30 * (ones - a))


def uneven_records(seed, objects=24, views=5):
    """splat and blank on objects of which each has values by a metric for some of its images.

    Some have none by some metric, and splat fails on some: what thin parts and failures do.
    """
    rng = np.random.default_rng(seed)
    made = []
    for obj in range(objects):
        fails = rng.random() < 0.3
        for method, view in product(("splat", "blank"), range(views)):
            where = {"method": method, "obj": f"o{obj:02}", "view": view}
            scores = {}
            for metric in IMAGE_METRICS:
                low, high = np.clip(value_range(metric), 0, 1)
                missing = metric_facts(metric).undefined and rng.random() < 0.6
                scores[column_of(metric)] = None if missing else float(rng.uniform(low, high))
            if method == "splat" and fails:
                made.append(make_failed(**where, prepare_s=1.0, draw_s=0.0))
            else:
                made.append(make_record(**where, **scores))
    return made


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("blanks", [False, True])
def test_a_value_of_a_table_is_that_of_the_comparison_and_lies_in_its_interval(seed, blanks):
    run = scored_records(to_frame(uneven_records(seed)))
    compared = compare(run, IMAGE_METRICS)
    for row in image_rows(run, IMAGE_METRICS, blanks).to_dict("records"):
        other = row_of(compared, method=row["method"], metric=row["metric"])
        assert row["failures_as_blank"] == other["value"]
        if blanks or not row["failed"]:
            assert [row[name] for name in VALUE] == [other[name] for name in VALUE]
        assert row["ci_low"] <= row["value"] <= row["ci_high"]
        assert len(row["per_object"]) >= 8


def test_each_object_counts_alike_however_many_of_its_images_have_a_value():
    """4 objects with 20 values of .9 and 20 with one of .2: (4 .9 + 20 .2) / 24 = .316667."""
    made = []
    for obj, view in product(range(24), range(20)):
        value = 0.9 if obj < 4 else 0.2 if view == 0 else None
        made += [make_record(m, obj=f"o{obj:02}", view=view, thin_recall=value) for m in METHODS]
    run = scored_records(to_frame(made))
    for row in image_rows(run, ["thin-recall"]).to_dict("records"):
        assert row["value"] == pytest.approx(7.6 / 24, abs=1e-15)
        assert row["n_ok"] == 4 * 20 + 20
        assert row["ci_low"] < row["value"] < row["ci_high"]
