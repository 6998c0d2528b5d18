"""The text of `bench compare` on a terminal: aligned, wrapped, with a verdict as its last line."""

from __future__ import annotations

import re
from math import nan

import pytest
from rich.cells import cell_len

from bench.tables.differences import comparison_lines

from ..differences import make_difference, make_differences

CONDITIONS = ("2048", "512", "noise-0.05")
HEADLINE = ("ssim-object", "lpips")


def lines(rows, width=80, **sides):
    return comparison_lines(make_differences(rows, **sides), width)


def better(**changes):
    return [
        make_difference(metric, condition, value, **changes)
        for metric, value in zip(HEADLINE, (0.1484, -0.0581), strict=True)
        for condition in CONDITIONS
    ]


@pytest.mark.parametrize(
    ("aheads", "verdict"),
    [
        ("bba", "splat-net is ahead in 2, behind in 1 of 3 cells (p < .05, corrected for 10)."),
        ("aaa", "splat-net is behind in 3 of 3 cells (p < .05, corrected for 10)."),
        (
            "b==",
            "splat-net is ahead in 1, not decided in 2 of 3 cells (p < .05, corrected for 10).",
        ),
        ("===", "No difference is shown in 3 cells (p < .05, corrected for 10)."),
        (
            "ba?",
            "splat-net is ahead in 1, behind in 1, not decided in 1 of 3 cells (p < .05, corrected "
            "for 10). Too few objects in 1: at least 8 are needed.",
        ),
    ],
)
def test_a_mixed_verdict_counts_the_cells(aheads, verdict):
    names = {"=": "tie", "?": "unknown"}
    shown = lines(
        [
            make_difference("lpips", condition, -0.1, names.get(ahead, ahead))
            for condition, ahead in zip(CONDITIONS, aheads, strict=True)
        ],
        width=200,
    )
    assert shown[-1] == f"{verdict} Intervals: --format md"
    words = {"b": "better", "a": "worse", "=": "not decided", "?": "undecided"}
    assert re.split(" {2,}", shown[4]) == ["lpips", *(words[ahead] for ahead in aheads)]


def test_too_few_objects_decide_nothing():
    shown = lines(better(ahead="unknown", objects=7))
    assert shown[0] == "splat-net against poisson on 7 objects (chair), paired"
    assert shown[4].split() == ["ssim-object", *["undecided"] * 3]
    assert shown[-1] == "7 objects decide nothing here: at least 8 are needed."
    alone = lines(better(ahead="unknown", objects=1))
    assert alone[-1] == "1 object decides nothing here: at least 8 are needed."


def test_no_value_on_either_side():
    rows = [make_difference("lpips", "2048", nan, "unknown"), *better()[:1]]
    shown = lines(rows)
    assert shown[4].split() == ["lpips", "-"]
    assert any(line.startswith("splat-net is ahead in 1 of 1 cell (") for line in shown)
    nothing = "24 objects decide nothing here: no cell has a value on both sides."
    assert lines(rows[:1])[-1] == nothing


def test_all_objects_and_the_classes_have_a_sentence_each():
    classes = [
        make_difference("lpips", "2048", -0.1, ahead, **{"class": name})
        for name, ahead in (("all", "b"), ("bench", "tie"), ("sofa", "a"), ("sofa", "b"))
    ]
    corrected = "(p < .05, corrected for 10)."
    assert " ".join(lines(classes, width=200)).endswith(
        f"splat-net is ahead in 1 of 1 cell of all objects {corrected} splat-net is ahead in 1, "
        f"behind in 1, not decided in 1 of 3 cells of the classes {corrected} "
        "Intervals: --format md"
    )


@pytest.mark.parametrize("width", [60, 40, 30, 20])
def test_a_narrow_terminal(width):
    """Conditions come in parts; nothing is left out."""
    shown = lines(better(), width, remarks=("`best-classical` is `denoised-wrap` at 2048.",))
    assert max(map(cell_len, shown)) <= width
    text = " ".join(shown)
    assert text.count("better") == 6
    assert text.count("+.148") == text.count("-.058") == 3


def test_names_are_shown_as_text():
    rows = better(**{"class": "a\x1b[2J"})
    shown = lines(rows, b="splat-net@\u202egnp", remarks=("`x\x07`",))
    assert all(line.isprintable() for line in shown)
