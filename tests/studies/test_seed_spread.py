"""The spread between trainings."""

from __future__ import annotations

import pandas as pd
import pytest

from bench.catalogue.methods import find_method
from bench.tables.paper import RESULTS
from data_prep.files.checksums import file_sha256
from studies.seed_spread import spreads


def test_lowest_and_highest_of_the_trainings():
    rows = [("a", 0.5), ("a@1", 0.53), ("a@2", 0.49), ("b", 0.9)]
    values = pd.DataFrame(
        [(m, c, "ssim", v) for c in ("2048", "512") for m, v in rows] + [("a", "512", "psnr", 9.0)],
        columns=["method", "condition", "metric", "value"],
    )
    actual = spreads(values, {"a": ("a", "a@1", "a@2")})
    assert list(actual["condition"]) == ["2048", "512"]
    assert set(actual["network"]) == {"a"}
    assert set(actual["trainings"]) == {3}
    assert actual["lowest"].tolist() == [0.49, 0.49]
    assert actual["spread"].tolist() == pytest.approx([0.04, 0.04])
    with pytest.raises(ValueError, match="ssim at 512"):
        spreads(values.drop(index=4), {"a": ("a", "a@1", "a@2")})


def test_the_recorded_spreads_are_of_the_bundled_weights():
    recorded = pd.read_csv(RESULTS / "seeds.csv", dtype={"condition": str})
    for network, checksum in zip(recorded["network"], recorded["weights_sha256"], strict=True):
        weights = find_method(network).weights_file
        assert weights is not None
        assert checksum == file_sha256(weights())
