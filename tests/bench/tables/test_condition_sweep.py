from __future__ import annotations

import csv
import io
import math

import pytest

from bench.analysis.condition_sweep import Crossover
from bench.catalogue.suites import TableSpec
from bench.tables.condition_sweep import (
    condition_sweep_table,
    crossover_text,
    end_to_end_text,
)

from ..analysis.test_condition_sweep import paired

SPEC = TableSpec("condition sweep", "t", "T")
# splat-net against pc2pix at 0, 0.05 and 0.10 of noise: ahead, undecided, behind
LEADS = [(0.1, 0.05, 0.15), (0.025, -0.025, 0.075), (-0.1, -0.15, -0.05)]
SURE = paired([(0.1, 0.05, 0.15), (0.2, 0.15, 0.25), (0.3, 0.25, 0.35)])


def rows(*paired_comparisons):
    return list(
        csv.DictReader(io.StringIO(condition_sweep_table(SPEC, "s", paired_comparisons).to_csv()))
    )


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
