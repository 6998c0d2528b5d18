"""The figure of `bench compare`."""

from __future__ import annotations

from math import nan

import numpy as np
import pytest

from bench.analysis.comparison import Estimate, Quality
from bench.analysis.paired import ComparedPair, PairedDifference, Side
from bench.report.differences import differences_figure


def cell(metric, value, class_name="chair"):
    quality = Quality(metric, Estimate(0.5, nan, nan), np.zeros(0))
    sides = Side("run", "splat"), Side("run", "splat-net")
    pair = ComparedPair("noise-0.05", class_name, *sides, quality, quality, 24)
    estimate = Estimate(value, value - 0.01, value + 0.01)
    return PairedDifference(pair, estimate, 0.001, 2)


@pytest.mark.parametrize(("metric", "better"), [("ssim-object", 0.1), ("lpips", -0.1)])
def test_better_is_to_the_right_on_every_axis(metric, better):
    figure = differences_figure([cell(metric, better), cell(metric, -better)], "splat", "splat-net")
    assert figure is not None
    (axis,) = figure.axes
    to_screen = axis.transData.transform
    assert to_screen((better, 0))[0] > to_screen((0, 0))[0] > to_screen((-better, 0))[0]


def test_without_a_difference_there_is_no_figure():
    assert differences_figure([cell("lpips", nan)], "a", "b") is None
