from __future__ import annotations

from bench.analysis.comparison import NAN, Estimate
from bench.analysis.crossings import Course
from bench.catalogue.families import FAMILIES
from bench.report.families import family_curves
from bench.report.styles import styles
from bench.report.tables import table_group
from bench.tables.crossings import crossings_table
from bench.tables.quality import Row, quality_table

from .test_crossings import contest

METHODS = ("pc2pix", "surface-apss", "blank")
NOISE, MISSING = FAMILIES[1], FAMILIES[3]


def table(name, metric, conditions):
    rows = tuple(
        Row("s", method, condition, "chair", metric, 0.1 * i + 0.01 * j, *[NAN] * 2, 4, 4, NAN,
            NAN, "")
        for i, condition in enumerate(conditions)
        for j, method in enumerate(METHODS)
    )  # fmt: skip
    return quality_table(name, name, rows, 3)


def course(family, metric):
    return Course("chair", family, metric, "pc2pix", (Estimate(NAN, NAN, NAN),) * 3)


def test_a_plot_for_each_family_and_metric():
    # in the order of the run, which is not that of the families
    conditions = ("missing-0.50", "noise-0.20", "noise-0.05", "2048", "missing-0.25", "1024")
    tables = [table("a", "ssim", conditions), table("b", "fd-views", conditions)]
    made = [course(f, m) for f in (NOISE, MISSING) for m in ("ssim", "fd-views")]
    plots = family_curves(tables, styles(METHODS), made)
    assert [plot.title for plot in plots] == [
        "ssim against noise, class chair",
        "fd-views against noise, class chair",
        "ssim against missing, class chair",
        "fd-views against missing, class chair",
    ]
    ticks = [[name for _, name in plot.x_ticks] for plot in plots]
    assert ticks[0] == ticks[1] == ["2048", "noise-0.05", "noise-0.20"]
    assert ticks[2] == ["2048", "missing-0.25", "missing-0.50"]
    assert plots[0].x_title == NOISE.axis
    assert [series.name for series in plots[0].series] == list(METHODS)
    # 2048, noise-0.05, noise-0.20 are the run's fourth, third and second
    assert "pc2pix: 2048 0.300, noise-0.05 0.200, noise-0.20 0.100." in plots[0].told


LEADS = [(0.1, 0.05, 0.15), (0.025, -0.025, 0.075), (-0.1, -0.15, -0.05)]


def test_who_is_ahead_stands_beside_the_leads():
    never = contest([(NAN, NAN, NAN), 0.1, (0.3, 0.2, 0.4)])
    made = crossings_table("s", (contest(LEADS), never, contest(LEADS, "missing")))
    ends, noise, missing = table_group(made).tables
    assert (ends.caption, noise.caption, missing.caption) == (
        "from end to end, chair",
        "lead along noise: standard deviation, in radii of the unit sphere, chair",
        "lead along missing on one side: share of the points, chair",
    )
    assert [table.unfolded for table in (ends, noise, missing)] == [False, True, False]
    assert [name for name, _ in noise.columns] == ["first", "second", "0", "0.05", "0.1"]
    conditions = ["", "", "2048", "noise-0.05", "noise-0.10"]
    assert [tags.condition for _, tags in noise.columns] == conditions
    first, second = noise.lines
    assert [first.name, *(c.text for c in first.cells[:2])] == ["ssim", "splat-net", "pc2pix"]
    assert [(c.text, c.beside, c.mark, c.gap) for c in first.cells[2:]] == [
        ("+0.100", "+0.050 to +0.150", "ahead", ""),
        ("+0.025", "-0.025 to +0.075", "", ""),
        ("-0.100", "-0.150 to -0.050", "", "behind"),
    ]
    assert [c.value for c in first.cells[2:]] == [0.1, 0.025, -0.1]
    assert [(c.text, c.beside, c.mark) for c in second.cells[2:]] == [
        ("-", "", ""),
        ("+0.100", "", ""),
        ("+0.300", "+0.200 to +0.400", "ahead"),
    ]
    assert [c.value for c in second.cells[2:]] == [None, 0.1, 0.3]
    assert noise.remark == "In training: splat-net 0 to 0.12, pc2pix 0 to 0.1."
    assert [name for name, _ in ends.columns][-1] == "ssim"
    text = ends.lines[1].cells[-1].text
    assert text.startswith("splat-net, then pc2pix; crosses at ")
