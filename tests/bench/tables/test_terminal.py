from __future__ import annotations

from dataclasses import replace

import pytest
from rich.cells import cell_len

from bench.tables.grid import BEST, OVER_OBJECTS, Cell, Grid, TableRow
from bench.tables.markdown import visible
from bench.tables.terminal import STAR, grid_lines, value_text

CONDITIONS = ("2048", "1024", "512", "noise-0.05", "noise-0.10")
METHODS = ("surface-apss", "pc2pix", "splat-net", "splat-net@grey")


def value(number, low, high, digits=3, **more):
    ends = (f"{low:.{digits}f}", f"{high:.{digits}f}")
    return Cell(f"{number:.{digits}f}", number, ends, **more)


def grid(metric, cells, names, conditions, **more):
    lines = tuple(TableRow(name, tuple(cells(name, c) for c in conditions)) for name in names)
    return Grid("method", tuple(conditions), lines, metric, **more)


def ssim(name, condition):
    return value(0.812, 0.75, 0.899, special=BEST if name == "splat-net" else None)


def grids(names=METHODS, conditions=CONDITIONS):
    distances = grid(
        "fd-views", lambda *cell: value(7.4, 0.5, 12.4, 1), names, conditions, higher=False
    )
    return [grid("ssim", ssim, names, conditions), distances]


def test_with_intervals_where_there_is_room():
    assert grid_lines(grids(METHODS[1:3], ("2048",)), 80, 40) == [
        "ssim, higher is better",
        "                          2048",
        "pc2pix      0.812 [.750, .899]",
        "splat-net  *0.812 [.750, .899]",
        "fd-views, lower is better",
        "                     2048",
        "pc2pix     7.4 [.5, 12.4]",
        "splat-net  7.4 [.5, 12.4]",
        f"{STAR}; [{OVER_OBJECTS}]",
    ]


def test_what_has_no_room_is_left_out_by_and_by():
    narrow = grid_lines(grids(), 80, 40)
    assert narrow[4].split() == ["splat-net", *["*0.812"] * 5]
    assert narrow[-1] == STAR  # no legend of what is not there
    many = [f"method-{i:02d}" for i in range(30)]
    shortest = grid_lines(grids(many), 60, 20)
    assert len(shortest) == 20
    assert shortest[-1] == "... 45 more lines, in the tables"


def test_a_value_of_blank_images_alone_is_a_dash():
    assert value_text(Cell("0.221", 0.221, count=(0, 4)), True) == "-"


def test_missing_values_notes_and_metrics_that_were_not_measured():
    part = grid("ssim", lambda *cell: Cell("-"), METHODS[:1], ("2048",), notes=("a: 20 x timeout",))
    void = grid("fid", lambda *cell: Cell("skipped"), METHODS[:1], ("2048",), void=True)
    void = replace(void, notes=("skipped: weights; see docs",))
    assert grid_lines([part, void], 80, 40) == [
        "ssim, higher is better",
        "              2048",
        "surface-apss     -",
        "a: 20 x timeout",
        "skipped: weights; see docs",
    ]
    many = grid_lines([replace(part, notes=tuple(f"method {i}: failed" for i in range(5)))], 80, 40)
    assert many[-2:] == ["method 2: failed", "... 2 more remarks, in the tables"]


@pytest.mark.parametrize("name", ["a\x1b[31mred", "x" * 90, "椅子" * 30, "\u202egnp", "[red]"])
def test_names_are_seen_whole(name):
    shown = grid_lines(grids((name, "splat")), 80, 80)
    assert all(line.isprintable() for line in shown)
    assert max(map(cell_len, shown)) <= 80
    assert visible(name)[-3:] in "".join(line.split()[0] for line in shown)
