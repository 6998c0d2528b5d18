from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from benchmarks.class_data import FEW, MANY, METRICS, differences, studies

CLASSES = ("airplane", "chair", "lamp")


def test_each_class_is_once_well_and_once_poorly_stocked() -> None:
    first, second, chairs, briefly = studies(CLASSES, steps=1000)
    assert first.objects == {"airplane": MANY, "chair": FEW, "lamp": MANY}
    assert second.objects == {"airplane": FEW, "chair": MANY, "lamp": FEW}
    assert chairs.objects == briefly.objects == {"chair": MANY}
    assert (first.steps, second.steps, chairs.steps) == (1000, 1000, 1000)
    # as many chairs as `second` draws: 300 of 360 objects
    assert briefly.steps == round(1000 * MANY / (MANY + 2 * FEW))


def test_differences_are_paired_and_have_the_right_sign() -> None:
    trained = studies(CLASSES)
    base = np.linspace(0.5, 0.7, 8)

    def table(offsets: dict[str, float]) -> pd.DataFrame:
        return pd.DataFrame(
            {"class": name, "object": i, **dict.fromkeys(METRICS, base[i] + offset)}
            for name, offset in offsets.items()
            for i in range(len(base))
        )

    measured = {
        "first": table({"airplane": 0.1, "chair": 0.0, "lamp": 0.2}),
        "second": table({"airplane": 0.05, "chair": 0.04, "lamp": 0.23}),
        "chairs": table({"chair": 0.10}),
        "chairs-briefly": table({"chair": 0.01}),
    }
    found = differences(measured, trained)
    of_ssim = found[found["metric"] == "ssim"]
    gains = {
        (q, c): (gain, low, high)
        for q, c, gain, low, high in of_ssim[
            ["question", "class", "gain", "ci_low", "ci_high"]
        ].itertuples(index=False)
    }
    close = lambda value: pytest.approx(value, abs=1e-12)  # noqa: E731
    # Offsets alone differ, so that every resample has the same mean: intervals are points.
    for key, gain in {
        ("more data", "airplane"): 0.05,
        ("more data", "chair"): 0.04,
        ("more data", "lamp"): -0.03,
        ("with other classes, as many chairs seen", "chair"): 0.03,
        ("with other classes, as many steps", "chair"): -0.06,
    }.items():
        assert gains[key] == (close(gain),) * 3
    gain, low, high = gains["more data", "all"]
    assert gain == close(0.02)
    # A bootstrap over three classes reaches from the least to the greatest of them.
    assert (low, high) == (close(-0.03), close(0.05))
