from __future__ import annotations

import math

import pandas as pd
import pytest

from bench.analysis.compare import Estimate
from bench.analysis.sweeps import FAMILY_BY_ID, better_of, crossings
from bench.catalogue.suites import TableSpec
from bench.tables.sweeps import crossing_text, end_to_end_text

SPEC = TableSpec("condition sweep", "t", "T")
ENDS = ["lead", "ci_low", "ci_high"]


def steps(leads, name="noise"):
    """Rows of splat-net against pc2pix, by their leads at the first steps of a family."""
    family, leads = FAMILY_BY_ID[name], [Estimate(*lead) for lead in leads]
    at = family.values[: len(leads)]
    cell = {"class": "chair", "family": name, "metric": "ssim"}
    sides = {"method": "splat-net", "rival": "pc2pix", "value": 0.5, "rival_value": 0.25}
    return pd.DataFrame(leads, columns=ENDS).assign(
        **cell,
        **sides,
        condition=family.conditions[: len(at)],
        at=[f"{value:g}" for value in at],
        unseen_by=[" ".join(family.unseen_by(value)) for value in at],
        ahead=[better_of(lead, "splat-net", "pc2pix") for lead in leads],
        **crossings(family, at, leads),
    )


def test_from_end_to_end():
    """At 0, 0.05 and 0.10 of noise."""
    for leads, message in (
        (
            [(0.1, 0.05, 0.15), (0.025, -0.025, 0.075), (-0.1, -0.15, -0.05)],
            "splat-net, then pc2pix; crosses at 0.06 [0.0333, 0.08]",
        ),
        ([(0.1, 0.05, 0.15), (0.2, 0.15, 0.25), (0.3, 0.25, 0.35)], "splat-net; none within"),
        (
            [(0.1, 0.05, 0.15), (-0.1, -0.15, -0.05), (0.1, 0.05, 0.15)],
            "splat-net; crosses at 0.025 [0.0125, 0.0375] and 0.075 [0.0625, 0.0875]",
        ),
    ):
        assert end_to_end_text(steps(leads).to_dict("records")) == message


@pytest.mark.parametrize(
    ("ends", "message"),
    [
        ((1448.155, 1024.0, 2048.0), "1448 [1024, 2048]"),
        ((0.13749, 0.1, 0.2), "0.137 [0.1, 0.2]"),
        ((0.5, math.nan, math.nan), "0.5"),
    ],
)
def test_where_it_crosses(ends, message):
    names = ("crossing", "crossing_low", "crossing_high")
    assert crossing_text(dict(zip(names, ends, strict=True))) == message
