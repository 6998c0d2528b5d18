"""The order of methods by a metric."""

from __future__ import annotations

from bench.catalogue.chosen import RANKINGS
from studies.chosen_order import in_order, rankings


def test_values_decide_and_where_they_are_equal_or_missing_the_other_order():
    otherwise, values = ["a", "b", "c", "d"], {"b": 0.5, "c": 0.7, "d": 0.5, "gone": 0.9}
    assert in_order(values, True, otherwise) == ["c", "b", "d", "a"]
    assert in_order(values, False, otherwise) == ["b", "d", "c", "a"]


def row(class_name: str, method: str, value: float) -> dict[str, str]:
    cell = {"metric": "lpips", "condition": "2048", "class": class_name}
    return {**cell, "method": method, "failures_as_blank": str(value)}


def test_a_run_decides_where_it_has_means_and_the_file_stays_elsewhere():
    before = RANKINGS.read_text(encoding="utf-8")
    assert rankings([row("chair", "splat", 0.0)]) == before
    after = rankings([row("average", "splat", 0.1), row("average", "alpha-wrap", 0.2)])
    changed = [
        new for new, old in zip(after.splitlines(), before.splitlines(), strict=True) if new != old
    ]
    assert [line[:29] for line in changed] == ["lpips,2048,splat alpha-wrap d"]
