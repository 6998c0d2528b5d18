from __future__ import annotations

import csv
import io
import math
from dataclasses import replace

import pytest

from bench.analysis.condition_sweep import Crossover
from bench.analysis.significant_digits import Precision
from bench.catalogue.families import FAMILIES
from bench.catalogue.suites import TableSpec
from bench.tables.condition_sweep import (
    condition_sweep_table,
    crossover_text,
    end_to_end_text,
    shown_in_training,
)

from ..analysis.test_condition_sweep import NAN, paired

SPEC = TableSpec("condition sweep", "t", "T")
# splat-net against pc2pix at 0, 0.05 and 0.10 of noise: ahead, undecided, behind
LEADS = [(0.1, 0.05, 0.15), (0.025, -0.025, 0.075), (-0.1, -0.15, -0.05)]
SURE = paired([(0.1, 0.05, 0.15), (0.2, 0.15, 0.25), (0.3, 0.25, 0.35)])


def rows(*paired_comparisons):
    return list(
        csv.DictReader(io.StringIO(condition_sweep_table(SPEC, "s", paired_comparisons).to_csv()))
    )


def test_csv_is_tidy():
    first, second, third = rows(paired(LEADS))
    columns = (
        "suite class family metric method rival condition at unseen_by value rival_value lead "
        "ci_low ci_high ahead crossing crossing_low crossing_high"
    )
    assert " ".join(first) == columns
    assert ",".join(first.values()) == (
        "s,chair,noise,ssim,splat-net,pc2pix,2048,0,,0.500000,0.250000,0.100000,"
        "0.050000,0.150000,splat-net,,,"
    )
    assert [row["ahead"] for row in (second, third)] == ["undecided", "pc2pix"]
    assert [row["at"] for row in (second, third)] == ["0.05", "0.1"]
    # 0.025 falls by 0.125 within 0.05: 0 after a fifth; the ends of the interval pass it after two
    # thirds of the first stretch (0.05 to -0.025) and three fifths of the second (0.075 to -0.05)
    assert (second["crossing"], second["crossing_low"], second["crossing_high"]) == (
        *("0.060000", "0.033333", "0.080000"),
    )
    assert third["crossing"] == ""
    (row, _) = rows(paired([(NAN, NAN, NAN), 0.1]))
    values = [row[name] for name in ("lead", "ci_low", "ci_high", "ahead")]
    assert values == ["", "", "", "no value"]


def test_csv_says_what_nobody_was_shown():
    one, both = "splat-net@chair", "splat-net@chair pc2pix"
    for family, unseen_by in (
        ("noise", ["", "", "", both, both]),
        ("points", ["", "", "", one, both]),
    ):
        assert [row["unseen_by"] for row in rows(paired([0.1] * 5, family))] == unseen_by


def test_from_end_to_end():
    twice = paired([(0.1, 0.05, 0.15), (-0.1, -0.15, -0.05), (0.1, 0.05, 0.15)])
    for comparison, message in (
        (paired(LEADS), "splat-net, then pc2pix; crosses at 0.06 [0.0333, 0.08]"),
        (SURE, "splat-net; none within"),
        (twice, "splat-net; crosses at 0.025 [0.0125, 0.0375] and 0.075 [0.0625, 0.0875]"),
    ):
        assert end_to_end_text(comparison) == message


@pytest.mark.parametrize(
    ("crossover", "message"),
    [
        (Crossover(0, 1448.155, 1024.0, 2048.0), "1448 [1024, 2048]"),
        (Crossover(0, 0.13749, 0.1, 0.2), "0.137 [0.1, 0.2]"),
        (Crossover(0, 0.5, math.nan, math.nan), "0.5"),
    ],
)
def test_where_it_crosses(crossover, message):
    assert crossover_text(crossover) == message


def test_what_training_has_shown():
    message = {family.id: shown_in_training(family) for family in FAMILIES}
    assert message["points"] == "splat-net@chair 512 to 2048, pc2pix 256 to 2048"
    assert message["missing"] == "splat-net@chair 0 only, pc2pix 0 only"


def test_grids():
    never = paired([(NAN, NAN, NAN), 0.1, (0.3, 0.2, 0.4)])
    ends, noise, missing = condition_sweep_table(
        SPEC, "s", (paired(LEADS), never, paired(LEADS, "missing"))
    ).grids()
    assert (ends.caption, noise.caption, missing.caption) == (
        "from end to end, chair",
        "lead along noise: standard deviation, in radii of the unit sphere, chair",
        "lead along missing on one side: share of the points, chair",
    )
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
    assert [(c.text, c.beside, c.mark, c.value) for c in second.cells[2:]] == [
        ("-", "", "", None),
        ("+0.100", "", "", 0.1),
        ("+0.300", "+0.200 to +0.400", "ahead", 0.3),
    ]
    assert noise.remark == "In training: splat-net@chair 0 to 0.12, pc2pix 0 to 0.1."
    assert [name for name, _ in ends.columns] == ["from", "to", "first", "second", "ssim"]
    assert [[c.text for c in line.cells] for line in ends.lines] == [
        ["2048", "noise-0.10", "splat-net", "pc2pix", "no value, then splat-net; none within"],
        ["2048", "missing-0.50", "splat-net", "pc2pix", end_to_end_text(paired(LEADS, "missing"))],
    ]


def test_markdown_of_several_classes_tells_them_apart():
    other = {"class_name": "a|b", "metric": "fd-views", "precisions": (Precision(1),) * 3}
    made = (paired(LEADS), replace(SURE, **other))
    lines = condition_sweep_table(SPEC, "s", made).to_markdown().splitlines()
    axis = "## noise: standard deviation, in radii of the unit sphere"
    assert [line for line in lines if line.startswith("## ")] == [
        *("## From end to end, chair", f"{axis}, chair"),
        *(r"## From end to end, a\|b", rf"{axis}, a\|b"),
    ]
    assert sum("splat-net, then pc2pix" in line for line in lines) == 1
    assert (
        "| ssim | splat-net | pc2pix | **+0.100 [+0.050, +0.150]** | +0.025 [-0.025, +0.075] | "
        "*-0.100 [-0.150, -0.050]* |"
    ) in lines
    assert (
        "| fd-views | splat-net | pc2pix | **+0.1 [+0.1, +0.1]** | **+0.2 [+0.1, +0.2]** | "
        "**+0.3 [+0.2, +0.3]** |"
    ) in lines
