from __future__ import annotations

import pytest
from builders import make_failed, make_record, to_frame

from bench.report.images import extremes


def frame(scores, method="splat", condition="2048", class_name="chair", metric="ssim"):
    """Records by (object, view)."""
    return [
        make_record(method, condition, obj, view, class_name=class_name, **{metric: score})
        for (obj, view), score in scores.items()
    ]


OF_FOUR = {
    ("a", 0): 0.1, ("a", 1): 0.2, ("b", 0): 0.3, ("b", 1): 0.9,
    ("c", 0): 0.8, ("c", 1): 0.85, ("d", 0): 0.5,
}  # fmt: skip
EQUAL = {(obj, view): 0.5 for obj in "dcba" for view in (1, 0)}


@pytest.mark.parametrize(
    ("metric", "records", "expected"),
    [
        # of different objects
        ("ssim", frame(OF_FOUR), ["worst a 0", "worst b 0", "best b 1", "best c 1"]),
        # the worst of a distance is the largest
        (
            "lpips",
            frame({("a", 0): 0.1, ("b", 0): 0.4, ("c", 0): 0.7, ("d", 0): 0.2}, metric="lpips"),
            ["worst c 0", "worst b 0", "best a 0", "best d 0"],
        ),
        # one image is not both, and equal scores are ordered by name
        ("ssim", frame({("a", 0): 0.4}), ["worst a 0"]),
        ("ssim", frame(EQUAL), ["worst a 0", "worst b 0", "best d 1", "best c 1"]),
        # failures, floors and the ceiling are no cases
        (
            "ssim",
            [
                make_failed("surface-apss", obj="a"),
                *frame({("a", 0): 0.0}, "blank"),
                *frame({("a", 0): 1.0}, "true-mesh"),
            ],
            [],
        ),
    ],
)
def test_extremes(metric, records, expected):
    chosen = extremes(to_frame(records), metric)
    columns = zip(chosen["kind"], chosen["object"], chosen["view"], strict=True)
    assert [f"{kind} {obj} {view}" for kind, obj, view in columns] == expected


def test_each_class_has_its_own_extremes_while_there_is_room():
    scores = {("a", 0): 0.1, ("b", 0): 0.9}
    chosen = extremes(to_frame([*frame(scores), *frame(scores, class_name="lamp")]), "ssim")
    found = set(zip(chosen["class"], chosen["kind"], chosen["object"], strict=True))
    assert found >= {("chair", "worst", "a"), ("lamp", "worst", "a")}
