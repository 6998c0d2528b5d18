"""The order of methods by a metric."""

from __future__ import annotations

from bench.catalogue.chosen import RANKINGS
from studies.chosen_order import in_order, rankings


def test_values_decide_and_where_they_are_equal_or_missing_the_other_order():
    otherwise, values = ["a", "b", "c", "d"], {"b": 0.5, "c": 0.7, "d": 0.5, "gone": 0.9}
    assert in_order(values, True, otherwise) == ["c", "b", "d", "a"]
    assert in_order(values, False, otherwise) == ["b", "d", "c", "a"]


def test_the_file_is_what_the_measurement_gives():
    assert RANKINGS.read_text(encoding="utf-8") == rankings()
