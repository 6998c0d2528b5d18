"""The order of methods by two metrics."""

from __future__ import annotations

import pandas as pd

from studies.chosen_order import in_order


def test_ranks_by_both_metrics_decide_and_lpips_where_they_are_equal():
    values = pd.DataFrame(
        {"ssim-object": [0.5, 0.6, 0.7, 0.1], "lpips": [-0.1, -0.2, -0.3, -0.4]},
        index=["sharp", "even", "similar", "worst"],
    )
    ordered = in_order(values)
    assert list(ordered.index) == ["sharp", "even", "similar", "worst"]
    assert list(ordered["rank"]) == [2.0, 2.0, 2.0, 4.0]
    assert list(in_order(values.assign(lpips=[-0.1, -0.2, -0.15, -0.4])).index) == [
        *("similar", "sharp", "even", "worst"),
    ]
