"""The report's plots: what they show, say and let the page hide."""

from __future__ import annotations

import re
from dataclasses import replace
from importlib import resources
from itertools import combinations

import matplotlib as mpl
import numpy as np
import pytest
from report_parser import parse

from bench.analysis.comparison import NAN, Comparison, Estimate, Quality
from bench.analysis.paired import Verdicts
from bench.analysis.scores import QualityRow
from bench.catalogue.metrics import higher_is_better
from bench.catalogue.suites import TableSpec
from bench.report.pareto import cost_plots
from bench.report.robustness import curve_panels, curves, robustness_figure
from bench.report.styles import PAPER, method_styles
from bench.tables.frontier import cost_grid
from bench.tables.markdown import visible
from bench.tables.quality import quality_table

METHODS = ("surface-apss", "splat", "true-mesh", "blank")


def row(method, condition, value, metric="ssim", class_name="chair", low=0.0, high=1.0):
    at = (method, condition, class_name, metric)
    return QualityRow("s", *at, value, low, high, 2, 2, NAN, value, "")


def table(*rows):
    return quality_table(TableSpec("images", "t", "T"), rows)


def drawn_svg(plot):
    return parse(f"<svg>{plot.svg.inside}</svg>")


def titles(plot):
    return [title.text for title in drawn_svg(plot).all("title")]


def test_curves_show_values_and_intervals():
    values = {
        ("splat", "2048"): (0.8, 0.7, 0.9), ("splat", "512"): (0.5, 0.45, 0.55),
        ("surface-apss", "2048"): (0.7, 0.7, 0.7), ("surface-apss", "512"): (0.4, 0.4, 0.4),
        ("true-mesh", "2048"): (1.0, 1.0, 1.0), ("true-mesh", "512"): (1.0, 1.0, 1.0),
        ("blank", "2048"): (0.6, 0.55, 0.65), ("blank", "512"): (0.6, 0.55, 0.65),
    }  # fmt: skip
    rows = [row(*at, v, low=low, high=high) for at, (v, low, high) in values.items()]
    tables, looked = [table(*rows)], method_styles(METHODS)
    (plot,) = curves(curve_panels(tables), looked)
    assert titles(plot) == [
        "splat, 2048, chair: 0.800 [0.700, 0.900]",
        "splat, 512, chair: 0.500 [0.450, 0.550]",
        "surface-apss, 2048, chair: ≈0.70 [0.70, 0.70]",
        "surface-apss, 512, chair: ≈0.40 [0.40, 0.40]",
    ]
    assert "splat: 2048 0.800, 512 0.500." in plot.description


@pytest.mark.parametrize(("metric", "blank"), [("ssim", 0.6), ("lpips", 0.6), ("fd-views", 150.0)])
def test_what_is_worse_than_a_white_image_is_shaded(metric, blank):
    rows = [row("splat", "2048", blank / 2, metric), row("blank", "2048", blank, metric)]
    (axis,) = robustness_figure(curve_panels([table(*rows)]), method_styles(METHODS)).figure.axes
    (band,) = axis.patches
    ends = sorted((band.get_y(), band.get_y() + band.get_height()))
    low, high = axis.get_ylim()
    expected = (low, blank) if higher_is_better(metric) else (blank, high)
    assert ends == pytest.approx(expected)


def test_colours_differ_for_the_colour_blind():
    """Colours are 20 apart in CIE 1976 L*a*b*, simulated by Machado et al. 2009 (severity 1)."""
    sheet = resources.files("bench.report").joinpath("assets", "report.css").read_text()
    light, dark = sheet.split("@media")[:2]
    for scheme in (light, dark):
        hues = [np.array(mpl.colors.to_rgb(c)) for c in re.findall(r"--hue-\d: (#\w+)", scheme)]
        assert len(hues) == 8
        for seen in (np.eye(3), DEUTERANOPIA, PROTANOPIA):
            labs = [lab(seen @ linear(hue)) for hue in hues]
            apart = [np.linalg.norm(a - b) for a, b in combinations(labs, 2)]
            assert min(apart) > 20


DEUTERANOPIA = np.array([
    [0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413],
    [-0.011820, 0.042940, 0.968881],
])  # fmt: skip
PROTANOPIA = np.array([
    [0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216],
    [-0.003882, -0.048116, 1.051998],
])  # fmt: skip


def linear(srgb):
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def lab(rgb):
    """CIE 1976 L*a*b* of linear sRGB, white D65."""
    to_xyz = np.array([
        [0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750],
        [0.0193339, 0.1191920, 0.9503041],
    ])  # fmt: skip
    t = to_xyz @ rgb.clip(0, 1) / [0.95047, 1, 1.08883]
    f = np.where(t > 0.008856, np.cbrt(t), 7.787 * t + 16 / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def test_the_page_can_hide_the_parts_of_a_plot():
    rows = [row(m, c, 0.5) for m in ("splat", "blank") for c in ("2048", "512")]
    (plot,) = curves(curve_panels([table(*rows)]), method_styles(METHODS))
    svg = drawn_svg(plot)
    series = svg.all("g", data_item="series")
    assert [g.attributes["data-method"] for g in series] == ["splat", "splat", "blank"]
    points = [g for g in svg.all("g", data_method="splat") if g.all("title")]
    assert [g.attributes["data-condition"] for g in points] == ["2048", "512"]
    assert all("data-method" in g.attributes or not g.all("title") for g in svg.all("g"))


def test_plots_take_their_colours_from_the_page_and_share_no_id():
    rows = [row(m, "2048", v, metric) for m, v in (("splat", 0.5), ("blank", 0.4))
            for metric in ("ssim", "fd-views")]  # fmt: skip
    first, second = curves(curve_panels([table(*rows)]), method_styles(METHODS))
    for plot in (first, second):
        assert "style=" not in plot.svg.inside
        colours = {
            element.attributes[name]
            for element in drawn_svg(plot).all()
            for name in ("fill", "stroke")
            if name in element.attributes
        }
        assert all(c in ("none", "currentColor") or c.startswith("var(--") for c in colours)
    ids, others = (
        {e.attributes["id"] for e in drawn_svg(plot).all() if "id" in e.attributes}
        for plot in (first, second)
    )
    assert ids
    assert not ids & others
    referred = set(re.findall(r"#([\w.-]+)", first.svg.inside))
    assert referred == ids


def test_names_of_methods_and_classes_are_only_text():
    hostile = "<script>alert(1)</script>\"'&{{ 7 }}$x$\u202e\x07"
    rows = [row(m, "2048", 0.5, class_name=k) for m in ("splat", hostile) for k in ("a", hostile)]
    (plot,) = curves(curve_panels([table(*rows)]), method_styles(["splat", hostile]))
    assert "<script" not in plot.svg.inside
    assert not re.search("[\u202e\x07]", plot.svg.inside)
    shown = [text.text for text in drawn_svg(plot).all("text")]
    assert visible(hostile) in shown  # of the class


def test_a_point_without_failed_images_is_hollow_and_says_what_it_is_with_them():
    failed = replace(row("splat", "512", 0.5), n_ok=1, n=4, failures_as_blank=0.45)
    tables = [table(row("splat", "2048", 0.8), failed, row("blank", "2048", 0.4))]
    (axis,) = robustness_figure(curve_panels(tables), method_styles(METHODS)).figure.axes
    faces = {
        line.get_ydata()[0]: line.get_markerfacecolor()
        for line in axis.lines
        if len(line.get_xdata()) == 1 and line.get_marker() not in ("", "None")
    }
    hue = method_styles(METHODS)["splat"].colour
    assert faces == {0.8: hue, 0.5: PAPER}
    assert axis.get_xlabel() == "hollow: failed images are left out"
    (plot,) = curves(curve_panels(tables), method_styles(METHODS))
    text = "splat, 512, chair: 0.500 [0.000, 1.000]; 1 of 4 images, 0.450 with blank ones for the "
    assert text + "others" in titles(plot)
    assert "splat: 2048 0.800, 512 (1 of 4) 0.500." in plot.description


def comparison(costs, values):
    """Three objects that are all alike."""
    prepare_s, draw_s = ({m: np.full(3, of[i]) for m, of in costs.items()} for i in (0, 1))
    qualities = {
        m: Quality("ssim", Estimate(v, v - 0.05, v + 0.05), np.full(3, v))
        for m, v in values.items()
    }
    images = dict.fromkeys(costs, (6, 6))
    return Comparison(
        "2048", "chair", ("a", "b", "c"), prepare_s, draw_s, images, {"ssim": qualities}
    )


COSTS = {"splat": (0.0, 0.005), "surface-apss": (0.8, 0.1), "true-mesh": (0, 0.01), "blank": (0, 0)}
QUALITIES = {"splat": 0.6, "surface-apss": 0.8, "true-mesh": 1.0, "blank": 0.5}


def test_costs_stand_beside_their_methods():
    made = [comparison(COSTS, QUALITIES)]
    (first,) = cost_plots(made, ["ssim"], 2, method_styles(METHODS), Verdicts([], made))
    svg = drawn_svg(first)
    series = [g.attributes["data-method"] for g in svg.all("g", class_="series")]
    assert sorted(series) == ["blank", "splat", "surface-apss"]
    assert titles(first) == [
        "splat: 10.0 ms, 0.600, on the frontier",
        "surface-apss: 1000 ms, ≈0.80, on the frontier",
        "blank: 0.500, looks at no cloud",
    ]
    assert first.title == "ssim: 2,048 points, chair"


@pytest.mark.parametrize(
    ("values", "images", "said", "marked", "gap"),
    [
        (
            QUALITIES,
            (2, 6),
            "splat: 10.0 ms, 0.600, on the frontier (2 of 6 images, the others scored as blank)",
            {"splat", "surface-apss"},
            "of 2 of 6 images",
        ),
        (
            QUALITIES | {"surface-apss": 0.55},
            (6, 6),
            "splat: 10.0 ms, 0.600, on the frontier",
            {"splat"},
            "",
        ),
        # `blank` has .5: the cheapest is no method at the frontier where it is worse
        (
            QUALITIES | {"splat": 0.45},
            (6, 6),
            "splat: 10.0 ms, 0.450, below a white image",
            {"surface-apss"},
            "below a white image",
        ),
    ],
)
def test_costs_say_who_is_at_the_frontier_and_of_how_many_images(values, images, said, marked, gap):
    made = comparison(COSTS, values)
    made = replace(made, images=made.images | {"splat": images})
    (plot,) = cost_plots([made], ["ssim"], 2, method_styles(METHODS), Verdicts([], [made]))
    assert titles(plot)[0] == said
    table = cost_grid([made], "ssim", 2, Verdicts([], [made]))
    assert table is not None
    assert {line.name for line in table.lines if line.cells[0].mark == "frontier"} == marked
    assert {line.name: line.cells[0].gap for line in table.lines} == {
        **dict.fromkeys(METHODS, ""),
        "splat": gap,
    }
    assert [line.cells[0].text for line in table.lines] == ["10.0", "1000", "20.0", "0.00"]
    assert table.lines[1].cells[0].beside == "800 + 100 × 2"


def test_without_times_there_is_no_cost():
    nothing = dict.fromkeys(METHODS, (np.nan, np.nan))
    made = [comparison(nothing, QUALITIES)]
    assert cost_plots(made, ["ssim"], 2, method_styles(METHODS), Verdicts([], made)) == ()
    assert cost_grid(made, "ssim", 2, Verdicts([], made)) is None
