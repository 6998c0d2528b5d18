from __future__ import annotations

import math

import numpy as np
import pandas as pd
import pytest

from bench.analysis.intervals import mean_interval
from bench.suites.latent.chairs import ALL
from bench.suites.latent.run import VALUES, means

pytestmark = pytest.mark.usefixtures("few_objects")

NAN = float("nan")


def values_of(numbers, what="code", kind=ALL, metric="step"):
    rows = [("pc2pix", what, kind, f"{kind} {i}", metric, x) for i, x in enumerate(numbers)]
    return pd.DataFrame(rows, columns=VALUES)


def test_means_and_intervals():
    """Missing values are counted; a kind has rows of its own after those of all."""
    (row,) = means("latent", values_of([1.0, 2.0, NAN, 6.0])).itertuples()
    assert (row.suite, row.method, row.what, row.kind) == ("latent", "pc2pix", "code", ALL)
    assert row.value == 3
    assert (row.ci_low, row.ci_high) == mean_interval(np.array([1.0, 2.0, 6.0]))
    assert (row.n_ok, row.n) == (3, 4)
    (row,) = means("latent", values_of([NAN, NAN])).itertuples()
    assert math.isnan(row.value)
    assert (row.n_ok, row.n) == (0, 2)
    kinds = [values_of([1.0, 3.0], kind="arms"), values_of([8.0], kind="slats")]
    rows = means("latent", pd.concat(kinds)).itertuples()
    assert [(row.kind, row.value, row.n) for row in rows] == [
        (ALL, 4, 3),
        ("arms", 2, 2),
        ("slats", 8, 1),
    ]
