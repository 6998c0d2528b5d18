from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.stats import t as student

from bench.analysis.comparison import (
    ALL,
    NAN,
    best_first,
    better_by,
    candidates,
    compare,
    difference,
    pooled,
)
from bench.analysis.distances import FeatureDistances
from bench.analysis.intervals import clipped, mean_interval, median_interval
from bench.metrics.frechet import frechet_distance
from bench.records.record import GROUND_TRUTH

from ..builders import (
    FeaturesAtHand,
    feature_index,
    frechet_interval,
    make_failed,
    make_record,
    scored_records,
    to_frame,
)
from .comparisons import comparison, quality

pytestmark = pytest.mark.usefixtures("few_objects")

# Seconds to prepare and to draw a view, and the ssim of two views, of each object.
SPLAT = {
    "a": (0.010, 0.001, (0.5, 0.7)),
    "b": (0.030, 0.002, (0.9, 0.9)),
    "c": (0.020, 0.009, (0.3, 0.1)),
}
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


def only(frame, metrics=("ssim",), features=None):
    (comparison,) = compare(scored_records(frame, features=features), metrics)
    return comparison


# c draws so slowly that it is the most expensive by 20 views
@pytest.mark.parametrize(("views", "cost_ms"), [(1, (11.0, 32.0, 29.0)), (20, (30.0, 70.0, 200.0))])
def test_cost_is_the_median_over_clouds(views, cost_ms):
    cost = only(to_frame(records())).cost_ms("splat", views)
    assert cost.value == pytest.approx(np.median(cost_ms), rel=1e-12)  # two roundings
    expected = median_interval(np.array(cost_ms), np.arange(3))
    assert (cost.low, cost.high) == pytest.approx(expected, rel=1e-12)


def test_a_cloud_that_failed_costs_the_time_that_it_took():
    """Older records do not have the time of a failed cloud."""
    taken = {"prepare_s": 0.5, "draw_s": 0.0}
    for failed, times, cost_ms in [
        ("c", taken, (30.0, 70.0, 500.0)),
        ("ab", taken, (500.0, 500.0, 200.0)),
        ("c", {}, (30.0, 70.0)),
    ]:
        comparison = only(to_frame(records(failed, **times)))
        cost = comparison.cost_ms("splat", 20)
        assert cost.value == pytest.approx(np.median(cost_ms), rel=1e-12)
        assert comparison.images["splat"] == (6 - 2 * len(failed), 6)
    never = only(to_frame(records("abc", **taken)))
    assert np.isnan(never.cost_ms("splat", 20)).all()
    assert never.images["splat"] == (0, 6)


def test_scores_are_means_over_objects_with_blanks_for_failures():
    whole = only(to_frame(records())).qualities["ssim"]["splat"]
    np.testing.assert_allclose(whole.per_object, [0.6, 0.9, 0.2], atol=1e-15)
    assert whole.estimate.value == pytest.approx(1.7 / 3, abs=1e-15)
    interval = clipped(mean_interval(np.array([0.6, 0.9, 0.2])), (-1.0, 1.0))
    np.testing.assert_allclose(whole.estimate[1:], interval)
    lost = only(to_frame(records(failed="b"))).qualities["ssim"]["splat"]
    np.testing.assert_allclose(lost.per_object, [0.6, 0.5, 0.2], atol=1e-15)


def test_objects_without_true_images_are_left_out():
    lost = [make_failed(m, obj="d", reason="input: no faces") for m in ("splat", "blank")]
    comparison = only(to_frame([*records(), *lost]))
    assert comparison.objects == ("a", "b", "c")
    assert comparison.images["splat"] == (6, 7)
    assert compare(scored_records(to_frame(lost)), ["ssim"]) == []


def test_a_comparison_for_each_condition_and_class():
    frame = to_frame(records())
    others = frame.assign(condition="512"), frame.assign(**{"class": "car"})
    made = compare(scored_records(pd.concat([frame, *others])), ["ssim"])
    found = [(c.condition, c.class_name) for c in made]
    assert found == [("2048", "car"), ("2048", "chair"), ("512", "chair")]


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
    return only(to_frame(made), ["fd-views"], measured).qualities["fd-views"]


def test_distances_are_those_of_the_tables():
    for method, found in distances().items():
        x, y = FEATURES[method], FEATURES[GROUND_TRUTH]
        assert found.estimate.value == frechet_distance(x, y)
        # the same sums in another order, a distance of some 1
        expected = frechet_interval(x, y, SHOWN, SHOWN)
        np.testing.assert_allclose(found.estimate[1:], expected, atol=1e-12)


def test_the_distance_of_failed_images_is_that_of_blank_ones():
    mixed = np.where((SHOWN == "c")[:, None], FEATURES["blank"], FEATURES["splat"])
    found = distances(without="c")["splat"].estimate.value
    assert found == frechet_distance(mixed, FEATURES[GROUND_TRUTH])
    none = distances(without=OBJECTS)
    assert none["splat"].estimate == none["blank"].estimate


def test_a_lead_in_distance_is_the_jackknife_of_the_difference():
    a, b = (distances()[method] for method in ("splat", "poisson"))
    found = better_by(a, b)

    def difference(rows):
        truth, splat, poisson = (
            FEATURES[name][rows] for name in (GROUND_TRUTH, "splat", "poisson")
        )
        return frechet_distance(poisson, truth) - frechet_distance(splat, truth)

    without = np.array([difference(obj != SHOWN) for obj in OBJECTS])
    # Efron and Stein 1981, as the standard deviation of the pseudo-values
    pseudo = 5 * difference(SHOWN != "") - 4 * without
    reach = student.ppf(0.975, 4) * pseudo.std(ddof=1) / np.sqrt(5)
    assert found.value == pytest.approx(b.estimate.value - a.estimate.value, abs=1e-12)
    ends = (found.value - reach, found.value + reach)
    assert (found.low, found.high) == pytest.approx(ends, abs=1e-9)
    assert better_by(b, a).value == -found.value


def test_a_single_object_gives_a_distance_without_an_interval():
    made = distances(objects="a")["splat"]
    assert np.isfinite(made.estimate.value)
    assert np.isnan(made.estimate[1:]).all()
    assert np.isnan(better_by(made, made)[1:]).all()


def test_a_lead_is_paired():
    a, b = quality("ssim", (0.91, 0.31, 0.61)), quality("ssim", (0.9, 0.3, 0.6))
    found = better_by(a, b)  # 0.01 on each object, though the objects are far apart
    np.testing.assert_allclose(found, [0.01, 0.01, 0.01], atol=1e-12)
    np.testing.assert_allclose(better_by(b, a), [-0.01, -0.01, -0.01], atol=1e-12)


def test_digits_that_are_not_printed_order_nothing():
    """Rivals are compared with surface-apss in its two decimals of lpips."""

    def values(metric, **scores):
        made = {m.replace("_", "-"): quality(metric, [v]) for m, v in scores.items()}
        return {m: replace(q, method=m) for m, q in made.items()}

    assert best_first(values("ssim", a=0.81449, b=0.8136, c=0.8146)) == {"c": 0, "a": 1, "b": 1}
    assert best_first(values("fd-views", a=4.62, b=4.58, c=NAN)) == {"a": 0, "b": 0}
    coarse = values("lpips", splat=0.234, surface_apss=0.231, pc2pix=0.226)
    assert best_first(coarse) == {"pc2pix": 0, "surface-apss": 0, "splat": 1}


def test_classes_are_pooled_object_by_object():
    chairs = comparison({"splat": (1.0, 2.0, (0.5, 0.7)), "blank": (0, 0, (0.1, 0.2))})
    sofas = comparison({"splat": (3.0, 4.0, (0.9,)), "blank": (0, 0, (0.6,))}, class_name="sofa")
    noisy = comparison({"splat": (1.0, 2.0, (0.5,)), "blank": (0, 0, (0.1,))}, condition="512")
    both, alone = pooled([chairs, noisy, sofas])
    assert (alone.condition, alone.objects) == ("512", ("chair/a",))  # the sofa has no true image
    assert (both.condition, both.class_name) == ("2048", ALL)
    assert both.objects == ("chair/a", "chair/b", "sofa/a")
    splat = both.qualities["ssim"]["splat"]
    assert splat.per_object.tolist() == [0.5, 0.7, 0.9]
    interval = clipped(mean_interval(splat.per_object), (-1.0, 1.0))
    assert splat.estimate == (pytest.approx(0.7), *interval)
    assert both.cost_ms("splat", 10).value == 21.0  # of 21, 21 and 43
    assert both.images["splat"] == (6, 6)


def test_no_distance_of_classes_together():
    """Sets of different classes have no distance of their own."""
    chairs, sofas = (
        comparison({"splat": (1, 1, (3.0, 4.0))}, "fd-views", class_name=name)
        for name in ("chair", "sofa")
    )
    assert pooled([chairs, sofas])[0].qualities == {}


def test_no_difference_is_larger_than_the_range_of_its_metric():
    """Seven of eight objects differ by the whole range of an IoU: Student's interval exceeds it."""
    ones, a = np.ones(8), np.array([0.0] * 7 + [0.9])
    found = difference(quality("silhouette-iou", ones), quality("silhouette-iou", a))
    assert mean_interval(ones - a)[1] > 1
    assert found == (pytest.approx(0.8875), mean_interval(ones - a)[0], 1.0)
    longer = difference(quality("psnr", 30 * ones), quality("psnr", 30 * a))
    assert longer[1:] == mean_interval(30 * (ones - a))
