from __future__ import annotations

from dataclasses import replace

import pytest

from bench.tables.grid import BEST, OVER_OBJECTS, Cell, ColumnHeader, Grid, TableRow
from bench.tables.plain import STAR, plain

CONDITIONS = ("2048", "1024", "512", "noise-0.05", "noise-0.10")


def value(number, low, high, digits=3, **more):
    shown = (f"{low:.{digits}f}", f"{high:.{digits}f}")
    return Cell(f"{number:.{digits}f}", number, shown, **more)


def grid(metric, cells, names, conditions, higher=True, **more):
    lines = tuple(TableRow(name, tuple(cells(name, c) for c in conditions)) for name in names)
    caption = f"{metric}, chair ({'higher' if higher else 'lower'} is better)"
    return Grid(
        "method", tuple(map(ColumnHeader, conditions)), lines, caption, higher=higher, **more
    )


def ssim(name, condition):
    return value(0.812, 0.75, 0.899, special=BEST if name == "splat-net" else None)


def distance(name, condition):
    return value(7.4, 0.5, 12.4, 1)


METHODS = ("surface-apss", "pc2pix", "splat-net", "splat-net@grey")


def grids(names=METHODS, conditions=CONDITIONS):
    return [
        grid("ssim", ssim, names, conditions),
        grid("fd-views", distance, names, conditions, higher=False),
    ]


def test_side_by_side_with_intervals_where_there_is_room():
    assert plain(grids(METHODS[1:3], ("2048",)), 80, 40) == [
        "           ssim, higher is better  fd-views, lower is better",
        "                             2048                       2048",
        "pc2pix         0.812 [.750, .899]             7.4 [.5, 12.4]",
        "splat-net      0.812*[.750, .899]             7.4 [.5, 12.4]",
        f"{STAR}; [{OVER_OBJECTS}]",
    ]


def test_both_ends_of_an_interval_stand_there():
    """An interval has two sides: the wider half on both would reach where no value can be."""
    cells = {
        "skewed": value(0.258, -0.246, 0.321),
        "bounded": value(0.996, 0.770, 1.0),
        "db": value(21.5, 9.75, 30.0, digits=2),
        "none": Cell("0.500", 0.5),
    }
    made = grid("ssim", lambda name, _: cells[name], tuple(cells), ("2048",))
    assert [line.split(maxsplit=1)[1].strip() for line in plain([made], 80, 40)[2:6]] == [
        "0.258 [-.246, .321]",
        "0.996 [.770, 1.000]",
        "21.50 [9.75, 30.00]",
        "0.500",
    ]


def test_what_has_no_room_is_left_out_by_and_by():
    narrow = plain(grids(), 80, 40)
    assert narrow[4] == "splat-net       0.812*  0.812*  0.812*      0.812*      0.812*"
    assert narrow[-1] == STAR  # no legend of what is not there
    assert plain(grids(), 240, 40)[0].count("better") == 2
    many = [f"method-{i:02d}" for i in range(30)]
    # 2 x 32 lines do not fit, nor do intervals side by side.
    below = plain(grids(many, CONDITIONS[:3]), 66, 40)
    assert len(below) == 32
    assert "[" not in "".join(below)
    shortest = plain(grids(many), 60, 20)
    assert len(shortest) == 20
    assert shortest[-1] == "... 45 more lines, in the tables"


def test_narrower_than_its_columns():
    shown = plain(grids(), 30, 80)
    assert max(map(len, shown)) <= 30
    found = [word for line in shown for word in line.split() if word in CONDITIONS]
    assert found == [*CONDITIONS, *CONDITIONS]


def test_missing_values_notes_and_metrics_that_were_not_measured():
    part = grid("ssim", lambda *cell: Cell("-"), METHODS[:1], ("2048",), notes=("a: 20 x timeout",))
    void = grid("fid", lambda *cell: Cell("skipped"), METHODS[:1], ("2048",), void=True)
    void = replace(void, notes=("skipped: weights; see docs",))
    assert plain([part, void], 80, 40) == [
        "              ssim, higher is better",
        "                                2048",
        "surface-apss                      -",
        "a: 20 x timeout",
        "skipped: weights; see docs",
    ]
    many = replace(part, notes=tuple(f"method {i}: failed" for i in range(5)))
    assert plain([many], 80, 40)[-2:] == ["method 2: failed", "... 2 more remarks, in the tables"]


@pytest.mark.parametrize("name", ["a\x1b[31mred", "x" * 90, "椅子" * 30, "\u202egnp"])
def test_names_are_seen_and_cut(name):
    from rich.cells import cell_len

    shown = plain(grids((name, "splat")), 80, 40)
    assert all(line.isprintable() for line in shown)
    assert max(map(cell_len, shown)) <= 80
