"""The text of `bench compare` on a terminal: aligned, wrapped, with a verdict as its last line."""

from __future__ import annotations

import re
from math import nan
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from rich.cells import cell_len

from bench.analysis.comparison import Estimate, Quality
from bench.analysis.paired import ComparedPair, PairedDifference, Side
from bench.analysis.run_pairs import Differences
from bench.catalogue.metrics import higher_is_better
from bench.catalogue.suites import TRUTHS
from bench.tables.verdict import comparison_lines

REPOSITORY = Path(__file__).parents[3]
CONDITIONS = ("2048", "512", "noise-0.05")
HEADLINE = ("ssim-object", "lpips")


def cell(metric, condition, value, ahead="b", **changes):
    """Return a cell of splat-net against poisson on 24 chairs."""
    about = {"objects": 24, "class_name": "chair", "method": ("poisson", "splat-net")} | changes
    quality = Quality(metric, Estimate(0.5, nan, nan), np.zeros(0))
    a, b = (Side("run", method) for method in about["method"])
    pair = ComparedPair(condition, about["class_name"], a, b, quality, quality, about["objects"])
    side = 1 if (ahead == "b") == higher_is_better(metric) else -1
    ends = {"tie": (-1.0, 1.0), "unknown": (nan, nan)}.get(ahead, tuple(sorted((side, 2.0 * side))))
    return PairedDifference(pair, Estimate(value, *ends), 0.001, 10)


def lines(cells, width=80, remarks=(), a="poisson", b="splat-net"):
    return comparison_lines(Differences(a, b, tuple(cells), remarks, TRUTHS["coloured"]), width)


def better(metrics=HEADLINE, **changes):
    return [
        cell(metric, condition, 0.1484 if metric == "ssim-object" else -0.0581, **changes)
        for metric in metrics
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
    cells = [
        cell("lpips", condition, -0.1, names.get(ahead, ahead))
        for condition, ahead in zip(CONDITIONS, aheads, strict=True)
    ]
    shown = lines(cells, width=200)
    assert shown[-1] == f"{verdict} Intervals: --format md"
    words = {"b": "better", "a": "worse", "=": "not decided", "?": "undecided"}
    assert re.split(" {2,}", shown[4]) == ["lpips", *(words[ahead] for ahead in aheads)]


def test_the_page_shows_the_verdict_on_the_sealed_chairs():
    rows = pd.read_csv(REPOSITORY / "results" / "docs" / "sealed-differences.csv")
    rows = rows[(rows.method_b == "splat-net@chair") & rows.metric.isin(HEADLINE)]
    cells = [
        cell(
            row.metric,
            str(row.condition),
            row.difference,
            row.ahead,
            objects=row.objects,
            method=(row.method_a, row.method_b),
        )
        for row in rows.itertuples()
    ]
    page = (REPOSITORY / "docs" / "compare.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"^```text\n(.*?)\n```", page, re.MULTILINE | re.DOTALL)
    best = "alpha-wrap", "alpha-wrap", "alpha-wrap", "denoised-wrap", "denoised-wrap"
    chosen = ", ".join(
        f"`{method}` at {condition}"
        for method, condition in zip(best, rows.condition.unique(), strict=True)
    )
    remarks = (f"`best-reconstruction` is {chosen}.",)
    shown = lines(cells, remarks=remarks, a="best-reconstruction", b="splat-net@chair")
    assert shown == block.splitlines()


def test_too_few_objects_decide_nothing():
    few = better(ahead="unknown", objects=7)
    shown = lines(few)
    assert shown[0] == "splat-net against poisson, 7 chairs, paired by chair"
    assert shown[4].split() == ["ssim-object", *["undecided"] * 3]
    assert shown[-1] == "7 chairs decide nothing here: at least 8 are needed."
    alone = lines(better(ahead="unknown", objects=1))
    assert alone[-1] == "1 chair decides nothing here: at least 8 are needed."


def test_no_value_on_either_side():
    unmeasured = [cell("lpips", "2048", nan, "unknown"), cell("ssim-object", "2048", 0.1, "b")]
    shown = lines(unmeasured)
    assert shown[4].split() == ["lpips", "-"]
    assert any(line.startswith("splat-net is ahead in 1 of 1 cell (") for line in shown)
    nothing = "24 chairs decide nothing here: no cell has a value on both sides."
    assert lines(unmeasured[:1])[-1] == nothing


def test_classes_are_blocks():
    """Name each block in its corner; the unit of several classes is an object."""
    classes = [*better(class_name="bench", objects=9), *better(class_name="sofa", objects=8)]
    shown = lines(classes)
    assert shown[0] == "splat-net against poisson, 17 objects, paired by object"
    assert [line.split()[0] for line in shown if line.endswith("noise 5 %")] == ["bench", "sofa"]
    whole = [*classes, *better(class_name="all", objects=17)]
    assert lines(whole)[0] == shown[0]
    benches = [*better(class_name="bench", objects=1), *better(class_name="bench", objects=2)]
    assert lines(benches)[0].endswith(", 2 benches, paired by bench")
    assert lines(better(class_name="meshes"))[0].endswith(", 24 objects, paired by object")


def test_all_objects_and_the_classes_have_a_sentence_each():
    classes = [
        cell("lpips", "2048", -0.1, ahead, class_name=k)
        for k, ahead in (("bench", "tie"), ("sofa", "a"), ("sofa", "b"))
    ]
    shown = lines([cell("lpips", "2048", -0.1, class_name="all"), *classes], width=200)
    corrected = "(p < .05, corrected for 10)."
    assert " ".join(shown).endswith(
        f"splat-net is ahead in 1 of 1 cell of all objects {corrected} splat-net is ahead in 1, "
        f"behind in 1, not decided in 1 of 3 cells of the classes {corrected} "
        "Intervals: --format md"
    )


@pytest.mark.parametrize("width", [60, 40, 30, 20])
def test_a_narrow_terminal(width):
    """Conditions come in parts, at last one below the other; nothing is left out."""
    shown = lines(better(), width, ("`best-reconstruction` is `denoised-wrap` at 2048.",))
    assert max(map(cell_len, shown)) <= width
    text = " ".join(shown)
    assert text.count("better") == 6
    assert text.count("+.148") == text.count("-.058") == 3


def test_names_are_shown_as_text():
    shown = lines(better(class_name="a\x1b[2J"), b="splat-net@\u202egnp", remarks=("`x\x07`",))
    assert all(line.isprintable() for line in shown)
