"""The figure of `bench compare`."""

from __future__ import annotations

from math import nan

import pytest

from bench.report.differences import differences_figure

from ..differences import make_difference, make_differences


@pytest.mark.parametrize(("metric", "better"), [("ssim-object", 0.1), ("lpips", -0.1)])
def test_better_is_to_the_right_on_every_axis(metric, better):
    rows = [make_difference(metric, "2048", value) for value in (better, -better)]
    figure = differences_figure(make_differences(rows))
    assert figure is not None
    (axis,) = figure.axes
    to_screen = axis.transData.transform
    assert to_screen((better, 0))[0] > to_screen((0, 0))[0] > to_screen((-better, 0))[0]


def test_without_a_difference_there_is_no_figure():
    assert differences_figure(make_differences([make_difference("lpips", "512", nan)])) is None
