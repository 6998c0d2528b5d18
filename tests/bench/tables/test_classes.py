from __future__ import annotations

import math

import numpy as np
import pandas as pd
import pytest

from bench.analysis.intervals import jackknife_interval, mean_interval
from bench.analysis.sets import ClassHead, FeatureDistances, confidences
from bench.catalogue.lookup import find
from bench.catalogue.suites import SUITES
from bench.metrics.frechet import JackknifeMoments, left_out_distances
from bench.metrics.kernel_distance import kernel_distance
from bench.records.job import GROUND_TRUTH
from bench.tables.quality import class_remark, class_table

from ..builders import (
    FeaturesAtHand,
    feature_index,
    make_failed,
    make_record,
    rows_of,
    scored_records,
    to_frame,
)

pytestmark = pytest.mark.usefixtures("few_objects")

SUITE = find("thirteen-classes", SUITES, "suite")
SPEC = SUITE.table("classes")
METHODS = ("surface-apss", "pc2pix@all", "blank")
OBJECTS = {"lamp": ("a", "b", "c"), "car": ("a", "b", "c", "d")}
SKIPPED = {"fid": "skipped: weights; not here"}
HEAD = ClassHead(("lamp", "car"), np.array([[1.0, 0, 0, 0], [0, 1.0, 0, 0]]), np.zeros(2))
PUBLISHED = {
    ("lamp", "fid", "2048", "surface-apss"): 51.6,
    ("lamp", "fid", "2048", "pc2pix@all"): 112.1,
    ("average", "fid", "2048", "pc2pix@all"): 57.2,
}


def images(class_name):
    return [(obj, view) for obj in OBJECTS[class_name] for view in (0, 1)]


def random_features():
    """Of 4 numbers, for the truth and all methods."""
    index = feature_index(METHODS, OBJECTS)
    blank = (index["method"] == "blank").to_numpy(np.float32)
    values = np.random.default_rng(0).random((len(index), 4), np.float32)
    return index, values + blank[:, None]


def chosen(index, method, class_name):
    """Which rows are of these."""
    return ((index["method"] == method) & (index["class"] == class_name)).to_numpy()


def records():
    rng = np.random.default_rng(1)
    return [
        make_record(m, obj=obj, view=view, class_name=k, ssim=rng.random())
        for m in METHODS
        for k in OBJECTS
        for obj, view in images(k)
    ]


def table_without(method, class_name, *lost):
    """These images have failed: they have no features."""
    of = [
        make_failed(r.method, obj=r.object, view=r.view, class_name=r.class_name)
        if (r.method, r.class_name) == (method, class_name) and (r.object, r.view) in lost
        else r
        for r in records()
    ]
    index, values = random_features()
    gone = [image in lost for image in zip(index["object"], index["view"], strict=True)]
    kept = ~(chosen(index, method, class_name) & np.array(gone))
    return table(of, features=FeaturesAtHand(index[kept], values[kept]))


def table(of=None, skipped=SKIPPED, features=None):
    features = features or FeaturesAtHand(*random_features())
    distances = FeatureDistances(features)
    run = scored_records(to_frame(of or records()), SUITE, {"fd-views": distances}, skipped)
    images = pd.concat(confidences(run.image_sets, distances, HEAD))
    run = run.with_metric("class-confidence", images)
    return class_table(run, SPEC, PUBLISHED)


def cell(made, **at):
    (row,) = [row for row in rows_of(made) if at.items() <= vars(row).items()]
    return row


def test_confidence_is_that_of_each_records_own_image():
    """Softmax of the first two features, 1 / (1 + exp(other - own)), in whatever order they are."""
    index, values = random_features()
    features = FeaturesAtHand(index, values)
    cells = scored_records(to_frame(records()), SUITE).image_sets
    found = pd.concat(confidences(cells, FeatureDistances(features), HEAD))
    assert len(found) == len(records())
    for _, record in found.iterrows():
        image = record["object"], record["view"]
        (value,) = features.of(record["method"], "2048", record["class"], [image])
        lamp, car = value[:2].astype(float)
        own, other = (lamp, car) if record["class"] == "lamp" else (car, lamp)
        assert record["class_confidence"] == pytest.approx(1 / (1 + np.exp(other - own)), rel=1e-12)
    of = (found["method"] == "surface-apss") & (found["class"] == "car")
    row = cell(table(), method="surface-apss", class_name="car", metric="class-confidence")
    assert row.value == pytest.approx(found.loc[of, "class_confidence"].mean(), rel=1e-12)
    assert row.ci_low < row.value < row.ci_high


def test_failed_images_have_no_confidence_and_count_as_blank():
    index, values = random_features()
    made = table_without("pc2pix@all", "lamp", ("b", 0), ("b", 1))
    at = {"method": "pc2pix@all", "class_name": "lamp"}
    row = cell(made, metric="class-confidence", **at)
    assert (row.n_ok, row.n) == (4, 6)
    assert math.isfinite(row.failures_as_blank)
    assert row.failures_as_blank != pytest.approx(row.value, rel=1e-3)
    row = cell(made, metric="kd-views", **at)
    truth, own, blank = (
        values[chosen(index, m, "lamp")] for m in (GROUND_TRUTH, "pc2pix@all", "blank")
    )
    kept = [0, 1, 4, 5]
    assert row.value == pytest.approx(kernel_distance(own[kept], truth[kept]), rel=1e-9)
    own[2:4] = blank[2:4]
    assert row.failures_as_blank == pytest.approx(kernel_distance(own, truth), rel=1e-9)
    assert row.note == "2 x timeout: 3 s"


def test_the_intervals_of_averages():
    of = records()
    made = table(of)
    at = {"method": "surface-apss", "class_name": "average"}
    frame = to_frame(of).query("method == 'surface-apss'")
    per_object = [
        frame[frame["class"] == k].groupby("object")["ssim"].mean().to_numpy()
        for k in ("car", "lamp")  # as records are sorted
    ]
    row = cell(made, metric="ssim", **at)
    assert (row.ci_low, row.ci_high) == pytest.approx(mean_interval(*per_object), rel=1e-12)

    index, values = random_features()
    leave_one_out = []
    for k in ("car", "lamp"):
        objects = np.array([obj for obj, _ in images(k)])
        truth, drawn = (
            JackknifeMoments(values[chosen(index, m, k)], objects)
            for m in (GROUND_TRUTH, "surface-apss")
        )
        leave_one_out.append(left_out_distances(drawn, truth))
    row = cell(made, metric="fd-views", **at)
    low, high = jackknife_interval(row.value, leave_one_out)
    assert (row.ci_low, row.ci_high) == pytest.approx((max(low, 0.0), high), rel=1e-9)


def test_a_frechet_distance_is_never_below_0_a_kernel_distance_may_be():
    """As true but for one object, on which everything hangs: the interval is wide."""
    index, values = random_features()
    for k in OBJECTS:
        values[chosen(index, "surface-apss", k)] = values[chosen(index, GROUND_TRUTH, k)]
    values[chosen(index, "surface-apss", "car") & (index["object"] == "a").to_numpy()] += 3.0
    made = table(features=FeaturesAtHand(index, values))
    for class_name in ("car", "average"):
        at = {"method": "surface-apss", "class_name": class_name}
        assert cell(made, metric="fd-views", **at).ci_low == 0.0
        assert cell(made, metric="kd-views", **at).ci_low < 0.0


def test_averages_are_of_the_same_classes_for_all_methods():
    """One image has no distance: no mean over fewer classes stands beside those over all."""
    made = table_without("surface-apss", "lamp", *images("lamp")[1:])
    at = {"method": "surface-apss", "metric": "fd-views"}
    average = cell(made, class_name="average", **at)
    assert math.isnan(average.value)
    assert math.isnan(average.ci_low)
    assert average.note == "no value in lamp"
    assert (average.n_ok, average.n) == (9, 14)
    of_ssim = cell(made, class_name="average", method="surface-apss", metric="ssim")
    classes = [
        cell(made, class_name=k, method="surface-apss", metric="ssim") for k in ("car", "lamp")
    ]
    assert of_ssim.value == pytest.approx(np.mean([row.value for row in classes]), rel=1e-12)
    assert of_ssim.note == f"lamp: {classes[1].note}"
    assert "4 x timeout: 3 s" in classes[1].note
    as_blank = np.mean([row.failures_as_blank for row in classes])
    assert of_ssim.failures_as_blank == pytest.approx(as_blank, rel=1e-12)


def test_what_is_skipped_says_why():
    other = "skipped: other weights"
    made = table(skipped=SKIPPED | {"class-confidence": other})
    reasons = {"fid": SKIPPED["fid"], "kid": SKIPPED["fid"], "class-confidence": other}
    for metric, reason in reasons.items():
        rows = [row for row in rows_of(made) if row.metric == metric]
        assert [row.note for row in rows] == [reason] * 9
        assert all(math.isnan(row.value) for row in rows)


def test_the_remark_names_what_is_lacking_and_what_is_few():
    message = class_remark(scored_records(to_frame(records()), SUITE))
    assert "Objects of each class: car 4, lamp 3." in message
    assert "Left out, because the dataset has none: airplane, bench, cabinet, chair," in message
    assert "**Fewer than 10 objects: car, lamp.**" in message
    many = [make_record(obj=str(i), class_name=k) for k in SUITE.classes for i in range(10)]
    message = class_remark(scored_records(to_frame(many), SUITE))
    assert "Left out" not in message
    assert "Fewer" not in message
