from __future__ import annotations

import csv
import io

from bench.analysis.comparison import NAN, Estimate
from bench.analysis.frontier import FrontierPoint, SubsampledFrontier
from bench.analysis.significant_digits import Precision
from bench.catalogue.suites import TableSpec
from bench.tables.frontier import frontier_table, points_table

NOTHING = Estimate(NAN, NAN, NAN)
SPEC = TableSpec("frontier", "t", "Quality against cost")


def place(method="splat", metric="ssim", verdict="frontier", baseline="", **changes):
    values = {
        "condition": "2048",
        "class_name": "chair",
        "views": 20,
        "cost_ms": Estimate(61.44, 60.0, 62.04),
        "quality": Estimate(0.81449, 0.8, 0.83),
        "n_ok": 39,
        "n": 40,
    }
    return FrontierPoint(
        method=method, metric=metric, verdict=verdict, baseline=baseline, **(values | changes)
    )


def rows(text):
    return list(csv.DictReader(io.StringIO(text)))


def test_csv_is_tidy():
    failed = place("poisson", verdict="no value", cost_ms=NOTHING, quality=NOTHING, n_ok=0)
    first, second = rows(frontier_table(SPEC, (place(baseline="a,b"), failed), "").to_csv())
    assert ",".join(first) == (
        "condition,class,views,metric,method,cost_ms,cost_ci_low,cost_ci_high,value,ci_low,ci_high,"
        "n_ok,n,verdict,rival"
    )
    assert " ".join(first.values()) == (
        "2048 chair 20 ssim splat 61.440000 60.000000 62.040000 0.814490 0.800000 0.830000 39 40 "
        "frontier a,b"
    )
    assert [second[name] for name in ("cost_ms", "value", "ci_low", "n_ok")] == ["", "", "", "0"]


def test_markdown_has_methods_by_cost_and_marks():
    costly, free = Estimate(1234.5, NAN, NAN), Estimate(0.4, 0.3, 0.5)
    nothing = {"cost_ms": NOTHING, "quality": NOTHING, "n_ok": 0}
    distance = {"metric": "fd-views", "quality": Estimate(12.34, 11.0, 13.0)}
    places = (
        place("poisson", verdict="no value", **nothing),
        place("pc2pix", verdict="tied", cost_ms=costly),
        place("splat"),
        place("true_mesh", verdict="reference", cost_ms=free),
        place("surface-fit", verdict="below a white image", baseline="blank", cost_ms=costly),
        place("poisson", "fd-views", "no value", **nothing),
        place("pc2pix", verdict="dominated", cost_ms=costly, **distance),
        place("splat", **distance),
        place("true_mesh", verdict="reference", cost_ms=free, **distance),
        place("splat", condition="512", views=1),
    )
    table = frontier_table(SPEC, places, "Taken in a hurry.")
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
        f"| surface-fit | 1234 | 0.814 {ssim} *below* | - | 39/40 |",
        "| poisson | - | - | - | 0/40 |",
    ]
    assert "## 512, chair, 1 view" in lines
    assert "claimed" not in table.to_markdown()


def test_a_claimed_cost_is_called_so():
    table = frontier_table(SPEC, (place("pc2pix", verdict="claimed"),), "")
    line = "| pc2pix | 61.4 [60.0, 62.0] *claimed* | 0.814 [0.800, 0.830] | 39/40 |"
    assert line in table.to_markdown().splitlines()
    assert "*claimed*: the author states this cost, of another machine" in table.to_markdown()


def test_points():
    full = SubsampledFrontier(
        "chair", "ssim", "splat", "2048", 2048, Estimate(21.0, 20.0, 22.0),
        Estimate(0.6, 0.5, 0.7), Estimate(0.0, 0.0, 0.0),
        Precision(3), Precision(3),
    )  # fmt: skip
    few = SubsampledFrontier(
        "chair", "ssim", "splat", "512", 512, Estimate(10.5, 10.0, 11.0),
        Estimate(0.45, 0.4, 0.5), Estimate(0.15, -0.01, 0.31),
        Precision(3), Precision(3),
    )  # fmt: skip
    table = points_table(SPEC, (few, full), 20)
    first, _ = rows(table.to_csv())
    assert first["points"] == "512"
    assert (first["lost"], first["lost_ci_low"]) == ("0.150000", "-0.010000")
    assert table.to_markdown().splitlines()[4:] == [
        "## ssim, chair",
        "",
        "| method | 2048 points | 512 points |",
        "|---|---|---|",
        "| splat | 0.600, 21.0 ms | 0.450, +0.150 [-0.010, +0.310], 10.5 ms |",
    ]
