"""The spread between trainings."""

from __future__ import annotations

import pandas as pd
import pytest

from studies.seed_spread import spreads


def test_lowest_and_highest_of_the_trainings():
    rows = [("a", 0.5), ("a@1", 0.53), ("a@2", 0.49), ("b", 0.9)]
    values = pd.DataFrame(
        [(m, c, "ssim", v) for c in ("2048", "512") for m, v in rows] + [("a", "512", "psnr", 9.0)],
        columns=["method", "condition", "metric", "value"],
    )
    found = spreads(values, {"a": ("a", "a@1", "a@2")})
    assert list(found["condition"]) == ["2048", "512"]
    assert set(found["network"]) == {"a"}
    assert set(found["trainings"]) == {3}
    assert found["lowest"].tolist() == [0.49, 0.49]
    assert found["spread"].tolist() == pytest.approx([0.04, 0.04])
    with pytest.raises(ValueError, match="ssim at 512"):
        spreads(values.drop(index=4), {"a": ("a", "a@1", "a@2")})
