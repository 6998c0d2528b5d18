"""Figures of the result pages: what they show, and that they are up to date."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

from studies.documents import REPOSITORY, read_lines
from studies.figures import FIGURES
from studies.plot_parts import DPI

DIFFERENT = 32  # grey levels; smaller differences come from other versions of matplotlib
SHARE = 0.0005  # of the pixels: a marker that moved changes more


@pytest.fixture(scope="module")
def figures():
    return {name: draw() for name, draw in FIGURES.items()}


def curves(axis):
    """Return the y values of each labelled line, parts joined."""
    return {line.get_label(): list(line.get_ydata()) for line in axis.get_lines()}


def test_curves_are_the_values_of_the_file_and_up_is_better(figures):
    similarity, distance = figures["known-chairs"].axes
    for axis, metric in ((similarity, "ssim-object"), (distance, "lpips")):
        values = {
            line["condition"]: float(line["value"])
            for line in read_lines(["sealed.csv"], {"method": "splat-net@chair", "metric": metric})
        }
        assert curves(axis)["splat-net@chair"] == [values[c] for c in ("2048", "1024", "512")]
    low, high = similarity.get_ylim()
    assert low < high
    low, high = distance.get_ylim()
    assert low > high


def test_differences_are_hollow_where_nothing_is_decided(figures):
    axis, _ = figures["thirteen-classes"].axes
    of_network = {"metric": "ssim-object", "method_b": "fused-net@grey"}
    of_other = {"metric": "ssim-object", "method_b": "splat-net@grey"}
    file = ["thirteen-classes-differences.csv"]
    lines = read_lines(file, of_network) + read_lines(file, of_other)
    points = [line for line in axis.get_lines() if len(line.get_xdata()) == 1]
    assert [p.get_xdata()[0] for p in points] == [float(line["difference"]) for line in lines]
    filled = [p.get_markerfacecolor() == p.get_color() for p in points]
    assert filled == [line["ahead"] in ("a", "b") for line in lines]


@pytest.mark.parametrize("name", FIGURES)
def test_figures_are_what_the_numbers_say(figures, name):
    """Run python -m studies.figures where this fails."""
    drawn = io.BytesIO()
    figures[name].savefig(drawn, format="png", dpi=DPI)
    now, stored = (
        np.asarray(Image.open(file).convert("L"), np.int16)
        for file in (drawn, REPOSITORY / "docs" / f"{name}.png")
    )
    assert now.shape == stored.shape
    assert (abs(now - stored) > DIFFERENT).mean() < SHARE
