from __future__ import annotations

import math
from itertools import product

import numpy as np
import pytest
from PIL import Image
from report_parser import parse

from bench.analysis.comparison import Estimate
from bench.analysis.condition_sweep import ConditionCurve
from bench.catalogue.conditions import FAMILIES
from bench.report.families import beyond_figure, family_curves, write_beyond_figures
from bench.report.styles import method_styles

from ..builders import make_job, make_truth, store_images

METRICS = ("ssim", "fd-views")
METHODS = ("surface-apss", "splat-net@chair", "pc2pix", "true-mesh", "constant", "blank")


def value(method, metric, step):
    falls = 0.9 - 0.1 * METHODS.index(method) - 0.05 * step
    return falls if metric == "ssim" else 100 * (1 - falls)


def every_curve(families=FAMILIES, methods=METHODS, metrics=METRICS):
    made = []
    for family, metric, method in product(families, metrics, methods):
        values = [value(method, metric, i) for i in range(len(family.steps))]
        estimates = tuple(Estimate(v, v - 0.02, v + 0.03) for v in values)
        made.append(ConditionCurve("chair", family, metric, method, estimates))
    return made


def figure(curves):
    return beyond_figure(curves, method_styles(c.method for c in curves)).figure


def bands(axis):
    """(left, right) of each band by its label."""
    return {
        patch.get_label(): (patch.get_x(), patch.get_x() + patch.get_width())
        for patch in axis.patches
        if patch.get_label().endswith("trained here")
    }


def curve(axis, method):
    """The line of a method, floors included."""
    (found,) = [line for line in axis.lines if line.get_label() == method]
    return found


def intervals(axis, method):
    """(least, greatest) of each interval of a method, which are in its colour."""
    hue = curve(axis, method).get_color()
    ends = [line for line in axis.lines if line.get_color() == hue and len(line.get_xdata()) == 2]
    return [tuple(line.get_ydata()) for line in ends if line.get_label().startswith("_")]


def test_lines_are_the_values_and_their_intervals():
    axes = figure(every_curve()).axes
    for axis, (family, metric) in zip(axes, product(FAMILIES, METRICS), strict=True):
        places = [math.log2(v) if family.logarithmic else v for v in family.values]
        for method in ("surface-apss", "splat-net@chair", "pc2pix", "constant", "blank"):
            x, y = curve(axis, method).get_xydata().T
            assert x.tolist() == places
            expected = [value(method, metric, i) for i in range(len(places))]
            assert y.tolist() == pytest.approx(expected)
        assert not any(line.get_label() == "true-mesh" for line in axis.lines)
    low, high = intervals(axes[0], "pc2pix")[1]
    middle = value("pc2pix", "ssim", 1)
    assert (low, high) == pytest.approx((middle - 0.02, middle + 0.03))


def test_bands_are_what_networks_were_shown():
    points, noise, outliers, *_ = figure(every_curve(metrics=("ssim",))).axes
    own, other = "splat-net@chair was trained here", "pc2pix was trained here"
    # room of 0.03 of the axis goes to bands that reach its first step, or are one value
    assert bands(points) == {own: pytest.approx((9, 11.12)), other: pytest.approx((8, 11.12))}
    shown = [*bands(noise)[own], *bands(noise)[other]]
    assert shown == pytest.approx([-0.006, 0.12, -0.006, 0.1])
    assert bands(outliers)[own] == pytest.approx((-0.003, 0.003))


def test_a_plot_of_the_page_for_each_family_and_metric():
    families, methods = (FAMILIES[1], FAMILIES[3]), ("pc2pix", "surface-apss", "blank")
    plots = family_curves(every_curve(families, methods), method_styles(methods))
    assert [plot.title for plot in plots] == [
        f"{metric} against {family}, class chair"
        for family in ("noise", "missing")
        for metric in METRICS
    ]
    svg = parse(plots[0].svg.inside)
    series = [g.attributes["data-method"] for g in svg.all("g", class_="series")]
    assert series == [*["pc2pix"] * 5, *["surface-apss"] * 5, "blank"]
    assert [title.text for title in svg.all("title")][:2] == [
        "pc2pix, 2048, chair: 0.700 [0.680, 0.730]",
        "pc2pix, noise-0.05, chair: 0.650 [0.630, 0.680]",
    ]
    assert "pc2pix: 2048 0.700, noise-0.05 0.650, noise-0.10 0.600, " in plots[0].description


def test_steps_without_value_or_interval():
    nan = float("nan")
    family = FAMILIES[1]
    description = (Estimate(0.9, nan, nan), Estimate(nan, nan, nan), *[Estimate(0.5, 0.4, 0.6)] * 3)
    (axis,) = figure([ConditionCurve("chair", family, "ssim", "splat", description)]).axes
    y = curve(axis, "splat").get_ydata()
    assert np.isnan(y).tolist() == [False, True, False, False, False]
    assert intervals(axis, "splat") == [(0.4, 0.6)] * 3


def drawn_files(folder, families, methods, jobs):
    artifacts = {job.name: store_images(folder, job, number) for number, job in enumerate(jobs)}
    write_beyond_figures(folder, every_curve(families, methods), artifacts)
    return {path.name for path in (folder / "figures").iterdir()}


def test_files(tmp_path):
    families = FAMILIES[3:4]
    jobs = [make_truth()]
    jobs += [make_job(None, m, c) for m in METHODS for c in families[0].conditions[:2]]
    names = {"beyond.png", "beyond.svg"}
    assert drawn_files(tmp_path, families, METHODS, jobs) == names | {"beyond-pictures.png"}
    with Image.open(tmp_path / "figures" / "beyond-pictures.png") as sheet:
        assert sheet.width == 800
    # of floors alone there are no images
    assert drawn_files(tmp_path / "floors", families, ("blank",), jobs[:1]) == names
