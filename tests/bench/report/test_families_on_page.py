from __future__ import annotations

from report_parser import parse

from bench.analysis.comparison import NAN, Estimate
from bench.analysis.crossings import ConditionCurve
from bench.catalogue.families import FAMILIES
from bench.report.build import table_group
from bench.report.families import family_curves
from bench.report.styles import looks
from bench.tables.crossings import crossings_table

from ..tables.test_crossings import paired

METHODS = ("pc2pix", "surface-apss", "blank")
NOISE, MISSING = FAMILIES[1], FAMILIES[3]


def curve(family, metric, method):
    values = (0.1 * i + 0.01 * METHODS.index(method) for i in range(len(family.steps)))
    estimates = tuple(Estimate(v, v - 0.005, v + 0.005) for v in values)
    return ConditionCurve("chair", family, metric, method, estimates)


def test_a_plot_for_each_family_and_metric():
    cells = [(f, m) for f in (NOISE, MISSING) for m in ("ssim", "fd-views")]
    made = [curve(*cell, method) for cell in cells for method in METHODS]
    plots = family_curves(made, looks(METHODS))
    assert [plot.title for plot in plots] == [
        "ssim against noise, class chair",
        "fd-views against noise, class chair",
        "ssim against missing, class chair",
        "fd-views against missing, class chair",
    ]
    svgs = [parse(plot.svg.inside) for plot in plots]
    texts = [[text.text for text in svg.all("text")] for svg in svgs]
    assert {f"{v:g}" for v in NOISE.values} <= set(texts[0]) & set(texts[1])
    assert {f"{v:g}" for v in MISSING.values} <= set(texts[2])
    assert NOISE.axis in texts[0]
    series = [g.attributes["data-method"] for g in svgs[0].all("g", class_="series")]
    assert series == list(METHODS)
    titles = [title.text for title in svgs[0].all("title")]
    assert titles[:2] == [
        "pc2pix, 2048, chair: 0.000 [-0.005, 0.005]",
        "pc2pix, noise-0.05, chair: 0.100 [0.095, 0.105]",
    ]
    assert "pc2pix: 2048 0.000, noise-0.05 0.100, noise-0.10 0.200, " in plots[0].description


LEADS = [(0.1, 0.05, 0.15), (0.025, -0.025, 0.075), (-0.1, -0.15, -0.05)]


def test_who_is_ahead_stands_beside_the_leads():
    never = paired([(NAN, NAN, NAN), 0.1, (0.3, 0.2, 0.4)])
    made = crossings_table("s", (paired(LEADS), never, paired(LEADS, "missing")))
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
