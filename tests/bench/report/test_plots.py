"""Plots: what they show and say, and how the page takes them in."""

from __future__ import annotations

import math
import re

import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest
from report_parser import parse

from bench.analysis.compare import NAN
from bench.analysis.differences import Verdicts
from bench.analysis.frontier import frontier_verdicts
from bench.catalogue.conditions import FAMILIES
from bench.catalogue.methods import BUNDLED
from bench.catalogue.metrics import higher_is_better
from bench.report.page import inline
from bench.report.run_figures import (
    cost_figures,
    differences_figure,
    family_figure,
    family_panels,
    quality_figure,
    quality_panels,
    write_frontier,
)
from bench.report.styles import PAPER, method_styles, rivals
from bench.tables.frontier import cost_grid
from bench.tables.markdown import visible

from ..analysis.comparisons import comparison as compared
from ..analysis.comparisons import curve_of
from ..builders import value_row, value_table
from ..differences import make_difference, make_differences
from ..tables.test_frontier import place

METHODS = ("surface-apss", "splat", "true-mesh", "blank")


def row(method, condition, value, metric="ssim", class_name="chair", low=0.0, high=1.0):
    changes = {"class": class_name, "ci_low": low, "ci_high": high, "objects": 24}
    return value_row(method, value, condition, metric, **changes)


def panels_of(*rows):
    return list(quality_panels([value_table(*rows)]).values())


def drawn(*rows, styles=METHODS):
    figure = quality_figure(panels_of(*rows), method_styles(styles))
    figure.draw_without_rendering()
    return figure


def line_of(axis, method):
    (line, *_) = [line for line in axis.lines if line.get_label() == method]
    return line


def intervals_of(axis, method):
    """(low, high) of the intervals of a method, which are in its colour."""
    hue = mpl.colors.to_rgba(line_of(axis, method).get_color())
    bars = [bars for bars in axis.collections if (bars.get_edgecolor() == hue).all()]
    segments = [s for b in bars if hasattr(b, "get_segments") for s in b.get_segments()]
    return [tuple(s[:, 1].tolist()) for s in segments if len(s) == 2]


def shaded(axis):
    """(low, high) of what is worse than a white image."""
    (band,) = [p for p in axis.patches if p.get_label() == "worse than a white image"]
    return sorted((band.get_y(), band.get_y() + band.get_height()))


def test_curves_show_values_and_intervals():
    values = {
        ("splat", "2048"): (0.8, 0.7, 0.9), ("splat", "512"): (0.5, 0.45, 0.55),
        ("splat", "noise-0.05"): (0.3, 0.2, 0.4),
        ("surface-apss", "2048"): (0.7, 0.7, 0.7), ("surface-apss", "512"): (0.4, 0.4, 0.4),
        ("true-mesh", "2048"): (1.0, 1.0, 1.0), ("true-mesh", "512"): (1.0, 1.0, 1.0),
        ("blank", "2048"): (0.6, 0.55, 0.65), ("blank", "512"): (0.6, 0.55, 0.65),
    }  # fmt: skip
    rows = [row(*at, v, low=low, high=high) for at, (v, low, high) in values.items()]
    (axis,) = drawn(*rows).axes
    assert axis.get_title() == "ssim (higher is better)"
    # Noise after fewer points lies beyond a gap, which no line crosses.
    assert line_of(axis, "splat").get_ydata().tolist() == [0.8, 0.5]
    assert intervals_of(axis, "splat") == [(0.7, 0.9), (0.45, 0.55), (0.2, 0.4)]
    assert [text.get_text() for text in axis.get_xticklabels()] == ["2,048", "512", "5 %"]
    assert [t.get_text() for t in axis.get_xticklabels(minor=True)] == ["points", "noise"]
    (names,) = axis.figure.legends
    assert [text.get_text() for text in names.get_texts()] == [
        *("splat", "surface-apss", "blank", "worse than a white image"),
    ]
    svg = parse(inline(drawn(*rows), "name", "words"))
    titles = [title.text for title in svg.all("title")]
    assert "splat, 512 of 2,048 points: 0.500, 24 chairs, 95 % interval 0.450 to 0.550" in titles
    names = [title.split(",")[0] for title in titles]
    assert names == ["splat"] * 3 + ["surface-apss"] * 2 + ["blank"]


@pytest.mark.parametrize(("metric", "blank"), [("ssim", 0.6), ("lpips", 0.6), ("fd-views", 150.0)])
def test_better_is_up_and_what_is_worse_than_a_white_image_is_shaded(metric, blank):
    better = 1.5 * blank if higher_is_better(metric) else blank / 2
    rows = [row("splat", "2048", better, metric), row("blank", "2048", blank, metric)]
    (axis,) = drawn(*rows).axes
    bottom, top = axis.get_ylim()
    assert (bottom < top) == higher_is_better(metric)
    assert shaded(axis) == pytest.approx(sorted((bottom, blank)))


def test_a_panel_without_a_better_side_says_so_and_distances_have_their_own_scale():
    rows = [row("splat", "2048", 0.9, "structure"), row("blank", "2048", 1.0, "structure")]
    (axis,) = drawn(*rows).axes
    assert axis.get_title().endswith("\nno method is better than a white image")
    assert not [patch for patch in axis.patches if patch.get_label() == "worse than a white image"]
    rows = [row("splat", "2048", 2.0, "fd-views"), row("blank", "2048", 150.0, "fd-views")]
    (axis,) = drawn(*rows).axes
    assert axis.get_yscale() == "log"
    assert 0.5 < min(axis.get_ylim()) < max(axis.get_ylim()) < 1000


def test_no_two_methods_look_alike():
    methods = rivals([*(method.id for method in BUNDLED), "my_method:METHOD", "other:METHOD"])
    styles = method_styles(methods).values()
    assert len({(style.colour, style.marker) for style in styles}) == len(methods)


def test_a_point_without_failed_images_is_hollow_and_says_of_how_many_it_is():
    failed = value_row("splat", 0.5, "512", n_ok=1, n=4, failures_as_blank=0.45)
    rows = (row("splat", "2048", 0.8), failed, row("blank", "2048", 0.4))
    (axis,) = drawn(*rows).axes
    outlines = [line for line in axis.lines if line.get_markerfacecolor() == PAPER]
    assert [y for line in outlines for y in line.get_ydata()] == [0.5]
    assert axis.get_xlabel() == "hollow: failed images are left out"
    title = "splat, 512 of 2,048 points: 0.500 (1 of 4 images)"
    assert title in inline(axis.figure, "name", "words")


def test_plots_take_their_colours_from_the_page_and_share_no_id():
    rows = [row(m, "2048", v) for m, v in (("splat", 0.5), ("blank", 0.4))]
    first, second = (inline(drawn(*rows), name, "words") for name in ("one", "two"))
    svg = parse(first)
    assert "style=" not in first
    colours = {e.attributes[k] for e in svg.all() for k in ("fill", "stroke") if k in e.attributes}
    assert all(c in ("none", "currentColor") or c.startswith("var(--") for c in colours)
    ids, others = ({e.attributes["id"] for e in parse(of).all() if "id" in e.attributes}
                   for of in (first, second))  # fmt: skip
    assert ids
    assert not ids & others
    assert set(re.findall(r"#([\w.-]+)", first)) <= ids
    assert svg.one("desc", id="one-description").text == "words"


def test_names_of_methods_and_classes_are_only_text():
    hostile = "<script>alert(1)</script>\"'&{{ 7 }}$x$\u202e\x07"
    rows = [row(m, "2048", 0.5, class_name=k) for m in ("splat", hostile) for k in ("a", hostile)]
    text = inline(drawn(*rows, styles=["splat", hostile]), "name", hostile)
    assert "<script" not in text
    assert not re.search("[\u202e\x07]", text)
    assert visible(hostile) in [element.text for element in parse(text).all("text")]  # a class


SHOWN = (  # method, cost, value, verdict
    ("surface-apss@resolution=25", 20, 0.60, "dominated"),
    ("surface-apss@resolution=50", 100, 0.70, "dominated"),
    ("surface-apss", 400, 0.80, "frontier"),
    ("surface-apss@resolution=300", 800, 0.78, "dominated"),
    ("pc2pix@acgan", 40, 0.75, "frontier"),
    ("pc2pix", 80, 0.75, "tied"),
    ("pc2pix@paper", 90, 0.75, "tied"),
    ("pc2pix@all", 95, 0.75, "tied"),
    ("splat", 10, 0.50, "frontier"),
    ("true-mesh", 30, 1.00, "reference"),
    ("constant", 1, 0.70, "reference"),
    ("blank", 1, 0.65, "reference"),
)


def placed(metric="ssim"):
    made = []
    for method, cost, value, verdict in SHOWN:
        shown = value if metric == "ssim" else 100 * (1.1 - value)
        estimates = {
            "cost_ms": (cost, 0.9 * cost, 1.1 * cost),
            "quality": (shown, 0.95 * shown, 1.05 * shown),
        }
        made.append(place(method, metric, verdict, **estimates))
    return made


def frontier_axis(points):
    points = pd.DataFrame(points)
    (figure,) = cost_figures(points, method_styles(points["method"])).values()
    (axis,) = figure.axes
    return axis


def test_a_parameter_is_a_line_and_the_frontier_a_step_to_the_edge():
    axis = frontier_axis(placed())
    swept = [[20, 0.6], [100, 0.7], [400, 0.8], [800, 0.78]]
    assert swept in [line.get_xydata().tolist() for line in axis.lines]
    steps = line_of(axis, "frontier")
    right = axis.get_xlim()[1]
    assert steps.get_xydata().tolist() == [[10, 0.5], [40, 0.75], [400, 0.8], [right, 0.8]]
    assert steps.get_drawstyle() == "steps-post"
    for label, value in (("constant", 0.7), ("blank", 0.65)):
        assert line_of(axis, label).get_ydata() == [value, value]
    drawn = np.concatenate([np.atleast_1d(line.get_ydata()) for line in axis.lines])
    assert drawn.max() < 0.9  # the ceiling is not drawn


@pytest.mark.parametrize("floor", [0.5, 0.52, 0.76, 0.82])
def test_labels_cover_no_floor_and_no_other_label(floor):
    shown = [point for point in placed() if point["method"] not in ("constant", "blank")]
    estimates = {"quality": (floor,) * 3, "cost_ms": (1.0, 1.0, 1.0)}
    axis = frontier_axis([*shown, place("blank", verdict="reference", **estimates)])
    boxes = {label.get_text(): label.get_window_extent() for label in axis.texts}
    assert {"splat", "pc2pix@acgan", "surface-apss"} <= boxes.keys()
    height = axis.transData.transform((1, floor))[1]
    for name, box in boxes.items():
        assert not box.y0 < height < box.y1, name
        assert box.count_overlaps(list(boxes.values())) == 1, name  # itself


def test_what_is_below_a_white_image_is_hollow():
    below = place("splat", verdict="below a white image", quality=(0.5, 0.4, 0.6))
    axis = frontier_axis([*placed()[:8], below])
    outlines = [line.get_ydata() for line in axis.lines if line.get_markerfacecolor() == PAPER]
    assert [y[0] for y in outlines if len(y) == 1] == [0.5]
    assert line_of(axis, "frontier").get_xydata()[0].tolist() == [40, 0.75]


def test_the_files_of_frontiers(tmp_path):
    axis = frontier_axis(placed("fd-views"))
    assert axis.get_yscale() == "log"
    assert axis.get_ylabel() == "fd-views (lower is better)"
    failed, none = (NAN, NAN, NAN), (0.0, 0.0, 0.0)  # 0 has no place
    lost = [place(m, "structure", "no value", quality=failed) for m in ("splat", "pc2pix")]
    lost.append(place("splat", "fd-views", quality=none))
    every = pd.DataFrame([*placed(), *placed("fd-views"), *lost])
    write_frontier(tmp_path / "figures", every)
    heads = {path.name: path.read_bytes()[:4] for path in (tmp_path / "figures").iterdir()}
    assert heads == {
        f"{name}.{kind}": head
        for name in ("frontier", "frontier-fd-views")
        for kind, head in (("png", b"\x89PNG"), ("svg", b"<?xm"))
    }


def comparison(costs, values):
    """Three objects that are all alike."""
    return compared({m: (*(1000 * s for s in costs[m]), (v,) * 3) for m, v in values.items()})


COSTS = {"splat": (0.0, 0.005), "surface-apss": (0.8, 0.1), "true-mesh": (0, 0.01), "blank": (0, 0)}
QUALITIES = {"splat": 0.6, "surface-apss": 0.8, "true-mesh": 1.0, "blank": 0.5}


def costs_of(made):
    return cost_figures(frontier_verdicts(made, 2, Verdicts(made)), method_styles(METHODS))


@pytest.mark.parametrize(
    ("values", "images", "said", "marked", "gap"),
    [
        (
            QUALITIES,
            (2, 6),
            "10.0 ms, 0.600, on the frontier, 2 of 6 images, the others scored as blank",
            {"splat", "surface-apss"},
            "2 of 6 images",
        ),
        (
            QUALITIES | {"surface-apss": 0.55},
            (6, 6),
            "10.0 ms, 0.600, on the frontier, 6 images",
            {"splat"},
            "",
        ),
        # `blank` has .5: the cheapest is no method at the frontier where it is worse
        (
            QUALITIES | {"splat": 0.45},
            (6, 6),
            "10.0 ms, 0.450, below a white image, 6 images",
            {"surface-apss"},
            "below a white image",
        ),
    ],
)
def test_costs_say_who_is_at_the_frontier_and_of_how_many_images(values, images, said, marked, gap):
    made = comparison(COSTS, values)
    made.loc[made["method"] == "splat", ["n_ok", "n"]] = images
    (figure,) = costs_of(made).values()
    titles = [title.text for title in parse(inline(figure, "name", "words")).all("title")]
    assert any(title.startswith(f"splat, 2,048 points: {said}") for title in titles)
    table = cost_grid(made, "ssim", 2, Verdicts(made))
    assert table is not None
    assert {line.name for line in table.lines if line.cells[0].mark == "frontier"} == marked
    assert {line.name: line.cells[0].gap for line in table.lines} == {
        **dict.fromkeys(METHODS, ""),
        "splat": gap,
    }
    assert [line.cells[0].text for line in table.lines] == ["10.0", "1000", "20.0", "0.00"]
    assert table.lines[1].cells[0].beside == "800 + 100 × 2"


IN_FAMILIES = ("surface-apss", "splat-net@chair", "pc2pix", "true-mesh", "constant", "blank")


def value(method, metric, step):
    falls = 0.9 - 0.1 * IN_FAMILIES.index(method) - 0.05 * step
    return falls if metric == "ssim" else 100 * (1 - falls)


def family_axes(*metrics):
    curves = pd.concat(
        curve_of(
            family, method, [value(method, metric, i) for i in range(len(family.steps))], metric
        )
        for family in FAMILIES
        for metric in metrics
        for method in IN_FAMILIES
    )
    return family_figure(family_panels(curves), method_styles(IN_FAMILIES)).axes


def test_lines_along_families_are_the_values_and_their_intervals():
    axes = family_axes("ssim", "fd-views")
    count = len(FAMILIES)
    assert [axis.get_title() for axis in axes[:3]] == ["points", "many points", "noise"]
    for metric, of_metric in (("ssim", axes[:count]), ("fd-views", axes[count:])):
        assert of_metric[0].get_ylabel().startswith(metric)
        for axis, family in zip(of_metric, FAMILIES, strict=True):
            at = [math.log2(v) if family.logarithmic else v for v in family.values]
            for method in ("surface-apss", "splat-net@chair", "pc2pix"):
                x, y = line_of(axis, method).get_xydata().T
                assert x.tolist() == at
                expected = [value(method, metric, i) for i in range(len(at))]
                assert y.tolist() == pytest.approx(expected)
            assert not any(line.get_label() == "true-mesh" for line in axis.lines)
    middle = value("pc2pix", "ssim", 1)
    assert intervals_of(axes[0], "pc2pix")[1] == pytest.approx((middle - 0.02, middle + 0.03))


def test_bands_are_what_networks_were_shown():
    def bands(axis):
        by_name = {patch.get_label().split()[0]: patch for patch in axis.patches}
        shown = [by_name[name] for name in ("splat-net@chair", "pc2pix")]
        return tuple((patch.get_x(), patch.get_x() + patch.get_width()) for patch in shown)

    points, _, noise, outliers, *_ = family_axes("ssim")
    # room of 0.03 of the axis goes to bands that reach its first step, or are one value
    assert bands(points) == (pytest.approx((9, 11.12)), pytest.approx((8, 11.12)))
    assert bands(noise) == (pytest.approx((-0.006, 0.12)), pytest.approx((-0.006, 0.1)))
    assert bands(outliers)[0] == pytest.approx((-0.003, 0.003))


@pytest.mark.parametrize(("metric", "better"), [("ssim-object", 0.1), ("lpips", -0.1)])
def test_better_is_to_the_right_on_every_axis(metric, better):
    rows = [make_difference(metric, "2048", better), make_difference(metric, "512", -better)]
    figure = differences_figure(make_differences(rows))
    assert figure is not None
    (axis,) = figure.axes
    to_screen = axis.transData.transform
    assert to_screen((better, 0))[0] > to_screen((0, 0))[0] > to_screen((-better, 0))[0]
    drawn = [x for line in axis.lines[:-1] for x in line.get_xdata()]
    assert sorted(drawn) == pytest.approx([-0.1, 0.1])


def test_without_times_there_is_no_cost():
    made = comparison(dict.fromkeys(METHODS, (np.nan, np.nan)), QUALITIES)
    assert costs_of(made) == {}
    assert cost_grid(made, "ssim", 2, Verdicts(made)) is None
