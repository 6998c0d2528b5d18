from __future__ import annotations

import pytest

from bench.records.job import shares


def test_shares_are_of_the_time_that_workers_had():
    assert shares({"methods": 6.0, "metrics": 1.0, "rendering": 2.0}, 20.0) == {
        "methods": 0.3,
        "metrics": 0.05,
        "rendering": 0.1,
        "harness": pytest.approx(0.55, abs=1e-15),
    }
    assert shares({}, 2.0) == {"methods": 0, "metrics": 0, "rendering": 0, "harness": 1.0}
