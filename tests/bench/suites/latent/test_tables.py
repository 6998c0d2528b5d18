from __future__ import annotations

import csv
import io
import math

import numpy as np
import pytest

from bench.analysis.intervals import mean_interval
from bench.suites.latent.tables import ALL, LatentValue, latent_table, means, values_table

pytestmark = pytest.mark.usefixtures("few_objects")

NAN = float("nan")


def values_of(numbers, what="code", kind=ALL, metric="step"):
    return [
        LatentValue("pc2pix", what, kind, f"{kind} {i}", metric, number)
        for i, number in enumerate(numbers)
    ]


def test_means_and_intervals():
    """Missing values are counted; a kind has rows of its own after those of all."""
    (row,) = means("latent", values_of([1.0, 2.0, NAN, 6.0]))
    assert (row.suite, row.method, row.what, row.kind) == ("latent", "pc2pix", "code", ALL)
    assert row.value == 3
    assert (row.ci_low, row.ci_high) == mean_interval(np.array([1.0, 2.0, 6.0]))
    assert (row.n_ok, row.n) == (3, 4)
    (row,) = means("latent", values_of([NAN, NAN]))
    assert math.isnan(row.value)
    assert (row.n_ok, row.n) == (0, 2)
    rows = means("latent", values_of([1.0, 3.0], kind="arms") + values_of([8.0], kind="slats"))
    assert [(row.kind, row.value, row.n) for row in rows] == [
        (ALL, 4, 3),
        ("arms", 2, 2),
        ("slats", 8, 1),
    ]


def test_csv_and_markdown():
    values = (
        values_of([1.0, 2.0, 6.0])
        + values_of([0.5, 0.5], what="noise")
        + values_of([NAN, 0.25], what="noise", metric="other")
        + values_of([NAN], kind="arms", metric="other")
    )
    explained = {"step": "of a path", "other": "of another"}, {"code": "of two", "noise": "of none"}
    table = latent_table("name", "Title", "Remark.", *explained, means("latent", values))
    rows = list(csv.DictReader(io.StringIO(table.to_csv())))
    low, high = mean_interval(np.array([1.0, 2.0, 6.0]))
    assert list(rows[0].items()) == [
        *(("suite", "latent"), ("method", "pc2pix"), ("what", "code"), ("kind", "all")),
        *(("metric", "step"), ("value", "3"), ("ci_low", f"{low:.6g}"), ("ci_high", f"{high:.6g}")),
        *(("n_ok", "3"), ("n", "3")),
    ]
    assert [(row["value"], row["ci_low"]) for row in rows[1:4]] == [
        ("0.5", "0.5"),
        ("0.25", ""),
        ("", ""),
    ]
    text = table.to_markdown()
    assert text.startswith("# Title\n\nRemark.\n")
    assert "* **code**: of two\n* **noise**: of none\n" in text
    assert "## pc2pix (n = 3)\n\n|  | code | noise |\n|---|---|---|\n" in text
    assert f"| step | 3 [{low:.3g}, {high:.3g}] | 0.5 [0.5, 0.5] |\n" in text
    assert "| other | - 0/1 | 0.25 1/2 |\n" in text
    assert "## pc2pix, arms only (n = 1)\n" in text
    assert "* step: of a path\n* other: of another\n" in text


def test_single_values():
    assert values_table("values", values_of([1 / 3, NAN])).to_csv() == (
        "method,what,kind,item,metric,value\n"
        "pc2pix,code,all,all 0,step,0.333333\n"
        "pc2pix,code,all,all 1,step,\n"
    )
