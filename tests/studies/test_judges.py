from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from bench.records.artifacts import Item
from studies.judges import correlations, disagreements, orders, values_of


class Line:
    """What `values_of` reads of a row."""

    def __init__(self, method, metric, value):
        self.condition, self.method, self.metric, self.value = "2048", method, metric, value


def table(**values):
    """Three methods with values by metric."""
    return values_of(
        [
            Line(method, metric.replace("_", "-"), value)
            for metric, of in values.items()
            for method, value in zip(("splat", "pc2pix", "blank"), of, strict=True)
        ]
    )


def test_orders_have_the_best_first_in_either_direction():
    made = table(ssim=(0.3, 0.2, 0.1), lpips=(0.3, 0.1, np.nan))
    assert orders(made).splitlines()[2:] == [
        "| ssim | 2048 | splat, pc2pix, blank |",
        "| lpips | 2048 | pc2pix, splat |",
    ]


def test_correlations_are_of_ranks_that_both_have():
    made = table(ssim=(0.3, 0.2, 0.1), lpips=(0.1, 0.2, 0.3), psnr=(10, 30, 20), fid=(1, 1, 1))
    lines = [line.split("|")[2:-1] for line in correlations(made).splitlines()[2:]]
    # ranks 1 2 3 and 3 1 2: 1 - 6 (4 + 1 + 1) / (3 * 8) = -0.5
    assert [[cell.strip() for cell in line] for line in lines] == [
        ["", "1.00", "-0.50", ""],
        ["1.00", "", "-0.50", ""],
        ["-0.50", "-0.50", "", ""],
        ["", "", "", ""],
    ]


def test_the_largest_disagreements():
    scores = {"splat": (0.9, 0.5), "pc2pix": (0.4, 0.1), "blank": (0.0, 0.0)}
    records = pd.DataFrame(
        {
            **{"method": method, "condition": "2048", "class": "chair", "object": obj},
            **{"view": view, "outcome": "ok", "ssim": ssim, "lpips": lpips - 0.01 * view},
        }
        for method, (ssim, lpips) in scores.items()
        for obj in "ab"
        for view in (0, 1)
    )
    (found,) = disagreements(records)  # a pair of methods stands there once; floors do not
    assert (found.a, found.b) == (
        Item("splat", "2048", "chair", "a"),
        Item("pc2pix", "2048", "chair", "a"),
    )
    assert found.size == pytest.approx(0.5 * 0.4)
    assert disagreements(records.assign(lpips=0.3)) == []
