"""Where the points of the report's plots are: closed forms of their values."""

from __future__ import annotations

import re

import numpy as np
import pytest

from bench.analysis.comparison import Comparison, Estimate, Quality
from bench.catalogue.metrics import higher_is_better
from bench.report.pareto import cost_plots
from bench.report.robustness import curves
from bench.report.styles import styles
from bench.tables.frontier import cost_grid
from bench.tables.quality import Row, quality_table
from bench.tables.table import NAN

METHODS = ("surface-apss", "splat", "true-mesh", "blank")
# Pixels of paths are written with one decimal.
PIXEL = 0.05 + 1e-9


def row(method, condition, value, metric="ssim", class_name="chair", low=None, high=None):
    low, high = (value if end is None else end for end in (low, high))
    return Row(
        "s", method, condition, class_name, metric, value, low, high, 2, 2, NAN, value, ""
    )  # fmt: skip


def table(*rows):
    return quality_table("t", "T", rows, decimals=3)


def path_points(path):
    return [tuple(map(float, pair)) for pair in re.findall(r"([\d.]+) ([\d.]+)", path)]


def test_curves_put_values_in_proportion():
    rows = [
        row("splat", "2048", 0.8, low=0.7, high=0.9),
        row("splat", "512", 0.5, low=0.45, high=0.55),
        row("surface-apss", "2048", 0.7),
        row("surface-apss", "512", 0.4),
        row("true-mesh", "2048", 1.0),
        row("true-mesh", "512", 1.0),
        row("blank", "2048", 0.6),
        row("blank", "512", 0.6),
    ]
    (plot,) = curves([table(*rows)], styles(METHODS))
    by_name = {series.name: series for series in plot.series}
    assert list(by_name) == ["splat", "surface-apss", "blank"]  # the ceiling is left out
    first, second = by_name["splat"].marks
    _, top, _, bottom = plot.area
    # 0.4 to 0.9 fill the axis but for a pad of 6 % of their reach at each end.
    scale = (bottom - top) / (0.5 * 1.12)
    assert second.y - first.y == pytest.approx(0.3 * scale)
    assert first.upright == pytest.approx((first.y + 0.1 * scale, first.y - 0.1 * scale))
    assert bottom - by_name["surface-apss"].marks[1].y == pytest.approx(0.03 * scale)
    assert path_points(by_name["splat"].path) == [
        (pytest.approx(mark.x, abs=PIXEL), pytest.approx(mark.y, abs=PIXEL))
        for mark in (first, second)
    ]
    assert by_name["blank"].marks[0].upright is None  # its interval is in the tables
    assert first.told == "splat, 2048, chair: 0.800 [0.700, 0.900]"
    assert "splat: 2048 0.800, 512 0.500." in plot.told
    xs = [series.marks[0].x for series in plot.series[:2]]
    assert xs[0] < plot.x_ticks[0][0] < xs[1]  # side by side about their condition
    heights = sorted(series.words[0].y for series in plot.series)
    assert min(np.diff(heights)) >= 15.0


def test_distances_far_apart_are_logarithmic():
    values = {"splat": 100.0, "surface-apss": 10.0, "blank": 1.0}
    rows = [row(m, "2048", v, "fd-views", low=0.0, high=v) for m, v in values.items()]
    (plot,) = curves([table(*rows)], styles(METHODS))
    ys = [series.marks[0].y for series in plot.series]
    assert ys[1] - ys[0] == pytest.approx(ys[2] - ys[1])
    assert ys[0] < ys[1]
    assert "lower is better, logarithmic" in plot.y_title
    assert plot.series[0].marks[0].upright == pytest.approx((plot.area[3], ys[0]))  # 0 is its end


def test_several_classes_stand_side_by_side():
    rows = [
        row(m, c, v, class_name=k)
        for m, v in (("splat", 0.5), ("blank", 0.4))
        for c in ("2048", "512")
        for k in ("chair", "lamp", "rifle")
    ]
    plots = curves([table(*rows), table(row("splat", "2048", 0.9))], styles(METHODS))
    assert [plot.title for plot in plots] == ["ssim at 2048, by class", "ssim at 512, by class"]
    assert [label for _, label in plots[0].x_ticks] == ["chair", "lamp", "rifle"]
    splat, blank = plots[0].series
    assert splat.path == ""
    assert blank.path.count("M") == 3
    assert plots[0].wide


def comparison(costs, qualities, condition="2048", metric="ssim"):
    """Three objects that are all alike."""
    return Comparison(
        condition,
        "chair",
        ("a", "b", "c"),
        prepare_s={m: np.full(3, prepare) for m, (prepare, _) in costs.items()},
        draw_s={m: np.full(3, draw) for m, (_, draw) in costs.items()},
        pictures=dict.fromkeys(costs, (6, 6)),
        qualities={
            metric: {
                m: Quality(metric, Estimate(v, v - 0.05, v + 0.05), np.full(3, v))
                for m, v in qualities.items()
            }
        },
    )


COSTS = {"splat": (0.0, 0.005), "surface-apss": (0.8, 0.1), "true-mesh": (0, 0.01), "blank": (0, 0)}
QUALITIES = {"splat": 0.6, "surface-apss": 0.8, "true-mesh": 1.0, "blank": 0.5}


def test_costs_are_logarithmic_and_the_frontier_steps_up():
    (plot,) = cost_plots([comparison(COSTS, QUALITIES)], ["ssim"], 2, styles(METHODS))
    by_name = {series.name: series for series in plot.series}
    assert set(by_name) == {"splat", "surface-apss", "blank"}
    splat, apss = (by_name[m].marks[0] for m in ("splat", "surface-apss"))
    left, top, right, bottom = plot.area
    # 10 ms and 1000 ms: two decades fill the axis but for a pad of 6 % at each end.
    assert apss.x - splat.x == pytest.approx((right - left) / 1.12)
    reach = 0.85 - 0.5  # from the floor to the end of the best interval
    assert splat.y - apss.y == pytest.approx(0.2 / reach * (bottom - top) / 1.12)
    assert by_name["blank"].marks[0].y == pytest.approx(bottom - 0.06 / 1.12 * (bottom - top))
    expected = f"M{splat.x:.1f} {splat.y:.1f}H{apss.x:.1f}V{apss.y:.1f}H{right:.1f}"
    assert plot.frontier == expected
    assert apss.told == "surface-apss: 1000 ms, 0.800, on the frontier"


def test_a_cheaper_and_better_method_leaves_one_step():
    worse = QUALITIES | {"surface-apss": 0.55}
    (plot,) = cost_plots([comparison(COSTS, worse)], ["ssim"], 2, styles(METHODS))
    assert plot.frontier.count("V") == 0
    table = cost_grid([comparison(COSTS, worse)], "ssim", 2)
    assert table is not None
    marks = {line.name: line.cells[0].mark for line in table.lines}
    assert marks == dict.fromkeys(METHODS, "") | {"splat": "frontier"}
    assert [line.cells[0].text for line in table.lines] == ["10.0", "1000", "20.0", "0.00"]
    assert table.lines[1].cells[0].beside == "800 + 100 × 2"


def test_a_plot_is_wide_where_labels_want_room():
    """Floors are named beside the plot and ceilings not at all, so that neither counts."""
    knobs = [f"splat@spread={0.5 + i / 10:g}" for i in range(13)]
    for many, wide in ((12, False), (13, True)):
        methods = (*knobs[:many], "true-mesh", "constant", "blank")
        costs = {method: (0.0, 0.01 + i / 1000) for i, method in enumerate(methods)}
        values = {method: 0.5 + i / 100 for i, method in enumerate(methods)}
        (plot,) = cost_plots([comparison(costs, values)], ["ssim"], 1, styles(methods))
        assert plot.wide == wide


def test_without_times_there_is_no_cost():
    nothing = dict.fromkeys(METHODS, (np.nan, np.nan))
    made = [comparison(nothing, QUALITIES)]
    assert cost_plots(made, ["ssim"], 2, styles(METHODS)) == ()
    assert cost_grid(made, "ssim", 2) is None


def test_methods_differ_in_form_and_settings_of_a_knob_do_not():
    single = ["splat", "pc2pix", "pc2pix@acgan", "surface-apss", "poisson"]
    look = styles([*single, "splat@spread=2", "blank"])
    markers = [look[method].marker for method in single]
    assert len(set(markers)) == 5
    assert look["splat"] == look["splat@spread=2"]
    assert look["blank"].marker == ""


def test_directions_of_metrics():
    better = [m for m in ("ssim", "thin-recall", "retrieval", "fid", "fd-views", "kid",
                          "azimuth-error-deg") if higher_is_better(m)]  # fmt: skip
    assert better == ["ssim", "thin-recall", "retrieval"]
