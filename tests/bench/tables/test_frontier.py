from __future__ import annotations

import pandas as pd

from bench.analysis.comparison import NAN
from bench.analysis.frontier import FRONTIER
from bench.catalogue.suites import TableSpec
from bench.tables.frontier import frontier_table

NOTHING = (NAN, NAN, NAN)
SPEC = TableSpec("frontier", "t", "Quality against cost")


def place(
    method="splat",
    metric="ssim",
    verdict="frontier",
    *,
    at=("2048", "chair", 20),
    cost_ms=(61.44, 60.0, 62.04),
    quality=(0.81449, 0.8, 0.83),
    n_ok=39,
):
    row = (*at, metric, method, *cost_ms, *quality, n_ok, 40, verdict, "")
    return dict(zip(FRONTIER, row, strict=True))


def table_of(*places, remark=""):
    return frontier_table(SPEC, pd.DataFrame(places), remark)


def test_markdown_has_methods_by_cost_and_marks():
    costly, free = (1234.5, NAN, NAN), (0.4, 0.3, 0.5)
    nothing = {"cost_ms": NOTHING, "quality": NOTHING, "n_ok": 0}
    distance = {"metric": "fd-views", "quality": (12.34, 11.0, 13.0)}
    table = table_of(
        place("poisson", verdict="no value", **nothing),
        place("pc2pix", verdict="tied", cost_ms=costly),
        place("splat"),
        place("true_mesh", verdict="reference", cost_ms=free),
        place("surface-fit", verdict="below a white image", cost_ms=costly),
        place("poisson", "fd-views", "no value", **nothing),
        place("pc2pix", verdict="dominated", cost_ms=costly, **distance),
        place("splat", **distance),
        place("true_mesh", verdict="reference", cost_ms=free, **distance),
        place("splat", at=("512", "chair", 1)),
        remark="Taken in a hurry.",
    )
    lines = table.to_markdown().splitlines()
    assert lines[:3] == ["# Quality against cost", "", "Taken in a hurry."]
    start = lines.index("## 2048, chair, 20 views")
    ssim, distance = "[0.800, 0.830]", "[11.0, 13.0]"
    assert lines[start + 2 : start + 9] == [
        "| method | ms | ssim | fd-views | images |",
        "|---|---|---|---|---|",
        f"| true_mesh | 0.40 [0.30, 0.50] | 0.814 {ssim} *ref* | 12.3 {distance} *ref* | 39/40 |",
        f"| splat | 61.4 [60.0, 62.0] | **0.814** {ssim} | **12.3** {distance} | 39/40 |",
        f"| pc2pix | 1234 | 0.814 {ssim} = | 12.3 {distance} | 39/40 |",
        "| surface-fit | 1234 | ≈0.81 [0.80, 0.83] *below* | - | 39/40 |",
        "| poisson | - | - | - | 0/40 |",
    ]
    assert "## 512, chair, 1 view" in lines
    assert "claimed" not in table.to_markdown()


def test_a_claimed_cost_is_called_so():
    table = table_of(place("pc2pix", verdict="claimed"))
    line = "| pc2pix | 61.4 [60.0, 62.0] *claimed* | 0.814 [0.800, 0.830] | 39/40 |"
    assert line in table.to_markdown().splitlines()
    assert "*claimed*: the author states this cost, of another machine" in table.to_markdown()
