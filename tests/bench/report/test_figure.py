"""What all figures share: files, cells with images, names beside lines."""

from __future__ import annotations

import numpy as np
import pytest

from bench.report.plots import drawing, panels, save
from bench.report.sheets import image_sheet


def a_figure():
    with drawing():
        figure, ((axis,),) = panels(1, 1, (3, 2))
        axis.plot([0, 1], [1, 2], label="a $x$ & <b>")
        axis.legend()
    return figure


@pytest.mark.parametrize(("kind", "head"), [("png", b"\x89PNG"), ("svg", b"<?xml")])
def test_the_same_figure_gives_the_same_bytes(tmp_path, kind, head):
    save(a_figure(), tmp_path / "new" / f"a.{kind}")
    save(a_figure(), tmp_path / f"b.{kind}")
    first = (tmp_path / "new" / f"a.{kind}").read_bytes()
    assert first.startswith(head)
    assert (tmp_path / f"b.{kind}").read_bytes() == first


def test_names_are_drawn_as_they_stand(tmp_path):
    """Neither formulas, nor marks, nor a complaint about signs that no font has."""
    save(a_figure(), tmp_path / "a.svg")
    assert ">a $x$ &amp; &lt;b&gt;<" in (tmp_path / "a.svg").read_text()
    image = np.zeros((4, 4, 3), np.uint8)
    grid = image_sheet(["title"], [("\u6905\u5b50\n\u202ename", [image])])
    save(grid, tmp_path / "b.png")
    assert grid.axes[0].get_ylabel() == "\u6905\u5b50\n\\u202ename"
