from __future__ import annotations

from report_parser import parse

from bench.analysis.comparison import NAN, Estimate
from bench.analysis.crossings import Course
from bench.catalogue.families import FAMILIES
from bench.report.families import crossings_group, family_curves
from bench.report.styles import looks
from bench.tables.crossings import CrossingsTable

from .test_crossings import contest

METHODS = ("pc2pix", "surface-apss", "blank")
NOISE, MISSING = FAMILIES[1], FAMILIES[3]


def course(family, metric, method):
    values = (0.1 * i + 0.01 * METHODS.index(method) for i in range(len(family.steps)))
    estimates = tuple(Estimate(v, v - 0.005, v + 0.005) for v in values)
    return Course("chair", family, metric, method, estimates)


def test_a_plot_for_each_family_and_metric():
    cells = [(f, m) for f in (NOISE, MISSING) for m in ("ssim", "fd-views")]
    made = [course(*cell, method) for cell in cells for method in METHODS]
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
    assert "pc2pix: 2048 0.000, noise-0.05 0.100, noise-0.10 0.200, " in plots[0].told


LEADS = [(0.1, 0.05, 0.15), (0.025, -0.025, 0.075), (-0.1, -0.15, -0.05)]


def test_who_is_ahead_stands_beside_the_leads():
    never = contest([(NAN, NAN, NAN), 0.1, (0.3, 0.2, 0.4)])
    group = crossings_group(CrossingsTable("s", (contest(LEADS), never, contest(LEADS, "missing"))))
    noise, missing = group.tables
    assert (noise.caption, missing.caption) == (
        "lead along noise, chair",
        "lead along missing, chair",
    )
    assert (noise.unfolded, missing.unfolded) == (True, False)
    assert [name for name, _ in noise.columns] == [
        *("2048", "noise-0.05", "noise-0.10", "curves cross at"),
    ]
    assert [tags.condition for _, tags in noise.columns] == ["2048", "noise-0.05", "noise-0.10", ""]
    first, second = noise.lines
    assert (first.name, first.about) == ("splat-net against pc2pix", "ssim")
    assert [(c.text, c.beside, c.mark, c.gap) for c in first.cells] == [
        ("+0.100", "+0.050 to +0.150", "ahead", ""),
        ("+0.025", "-0.025 to +0.075", "", ""),
        ("-0.100", "-0.150 to -0.050", "", "behind"),
        ("0.06 [0.0333, 0.08]", "", "", ""),
    ]
    assert [c.value for c in first.cells[:3]] == [0.1, 0.025, -0.1]
    assert [(c.text, c.beside, c.mark) for c in second.cells] == [
        ("-", "", ""),
        ("+0.100", "", ""),
        ("+0.300", "+0.200 to +0.400", "ahead"),
        ("none within", "", ""),
    ]
    assert [c.value for c in second.cells] == [None, 0.1, 0.3, None]
    assert noise.notes == (
        "noise: standard deviation, in radii of the unit sphere; in training: splat-net 0 to 0.12, "
        "pc2pix 0 to 0.1",
    )
