from __future__ import annotations

from itertools import product

import pytest
from builders import make_failed, make_record, to_frame

from bench.report.build import failure_groups
from bench.report.images import EACH, MOST_CASES, extremes, shown_objects


def frame(scores, method="splat", condition="2048", class_name="chair"):
    """Records by (object, view)."""
    return [
        make_record(method, condition, obj, view, ssim=ssim, class_name=class_name)
        for (obj, view), ssim in scores.items()
    ]


def picked(records):
    chosen = extremes(to_frame(records), "ssim")
    columns = zip(chosen["kind"], chosen["object"], chosen["view"], chosen["ssim"], strict=True)
    return [(kind, obj, int(view), float(ssim)) for kind, obj, view, ssim in columns]


def test_extremes_are_of_different_objects():
    scores = {
        ("a", 0): 0.1, ("a", 1): 0.2, ("b", 0): 0.3, ("b", 1): 0.9,
        ("c", 0): 0.8, ("c", 1): 0.85, ("d", 0): 0.5,
    }  # fmt: skip
    assert picked(frame(scores)) == [
        ("worst", "a", 0, 0.1),
        ("worst", "b", 0, 0.3),
        ("best", "b", 1, 0.9),
        ("best", "c", 1, 0.85),
    ]


def test_the_worst_of_a_distance_is_the_largest():
    records = [
        make_record("splat", "2048", obj, 0, lpips=lpips)
        for obj, lpips in (("a", 0.1), ("b", 0.4), ("c", 0.7), ("d", 0.2))
    ]
    chosen = extremes(to_frame(records), "lpips")
    assert list(zip(chosen["kind"], chosen["object"], strict=True)) == [
        *(("worst", "c"), ("worst", "b"), ("best", "a"), ("best", "d")),
    ]


def test_one_image_is_not_both_and_equal_scores_are_ordered_by_name():
    assert picked(frame({("a", 0): 0.4})) == [("worst", "a", 0, 0.4)]
    equal = {(obj, view): 0.5 for obj in "dcba" for view in (1, 0)}
    assert [case[1:3] for case in picked(frame(equal))[:2]] == [("a", 0), ("b", 0)]


def test_failures_floors_and_ceiling_are_no_cases():
    records = [make_failed("surface-apss", obj="a"), *frame({("a", 0): 0.0}, "blank")]
    records += frame({("a", 0): 1.0}, "true-mesh")
    assert picked(records) == []


def test_each_class_has_its_own_extremes_while_there_is_room():
    scores = {("a", 0): 0.1, ("b", 0): 0.9}
    chosen = extremes(to_frame([*frame(scores), *frame(scores, class_name="lamp")]), "ssim")
    found = set(zip(chosen["class"], chosen["kind"], chosen["object"], strict=True))
    assert found >= {("chair", "worst", "a"), ("lamp", "worst", "a")}


@pytest.mark.parametrize(("methods", "classes"), [(4, 1), (30, 1), (6, 13), (30, 13)])
def test_their_number_is_bounded(methods, classes):
    scores = {(obj, 0): 0.1 * i for i, obj in enumerate("abcdef")}
    records = [
        record
        for m, c in product(range(methods), range(classes))
        for condition in ("2048", "1024", "512")
        for record in frame(scores, f"plugin-{m}", condition, f"class-{c}")
    ]
    chosen = extremes(to_frame(records), "ssim")
    assert 2 * methods * 3 <= len(chosen) <= max(MOST_CASES, 2 * EACH * methods * 3)
    assert len(chosen) <= MOST_CASES


def test_objects_are_the_first_that_have_images():
    records = [make_failed(obj="a"), *frame({(obj, 0): 0.5 for obj in "gfedcb"})]
    assert shown_objects(to_frame(records)) == [("chair", obj) for obj in "bcde"]
    records += frame({("z", 0): 0.5}, class_name="lamp")
    assert shown_objects(to_frame(records)) == [("chair", "b"), ("lamp", "z")]


def test_failures_beyond_the_list_are_counted():
    records = [make_failed(obj=f"o{i:03d}", view=2) for i in range(203)]
    (group,) = failure_groups(to_frame(records))
    assert (group.count, len(group.failures), group.more) == ("203 images of 203 clouds", 200, 3)
    assert (group.failures[0].name, group.failures[0].views) == ("splat/2048/chair/o000", "view 2")
