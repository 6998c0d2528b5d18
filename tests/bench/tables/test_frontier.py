from __future__ import annotations

import pandas as pd

from bench.analysis.compare import NAN
from bench.analysis.frontier import FRONTIER
from bench.catalogue.suites import TableSpec
from bench.tables.frontier import frontier_table

NOTHING = (NAN, NAN, NAN)
SPEC = TableSpec("frontier", "t", "Quality against cost")


def place(
    method="splat",
    metric="ssim",
    verdict="frontier",
    *,
    at=("2048", "chair", 20),
    cost_ms=(61.44, 60.0, 62.04),
    quality=(0.81449, 0.8, 0.83),
    n_ok=39,
):
    row = (*at, metric, method, *cost_ms, *quality, n_ok, 40, verdict, "")
    return dict(zip(FRONTIER, row, strict=True))


def table_of(*places, remark=""):
    return frontier_table(SPEC, pd.DataFrame(places), remark)


def test_a_claimed_cost_is_called_so():
    table = table_of(place("pc2pix", verdict="claimed"))
    line = "| pc2pix | 61.4 [60.0, 62.0] *claimed* | 0.814 [0.800, 0.830] | 39/40 |"
    assert line in table.to_markdown().splitlines()
    assert "*claimed*: the author states this cost, of another machine" in table.to_markdown()
