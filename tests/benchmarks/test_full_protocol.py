from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from bench.records.record import GROUND_TRUTH
from benchmarks.full_protocol import Costs, jobs_of, overhead_of, planned, read_costs, simulate
from data_prep.failures import BadInput


@pytest.fixture
def costs() -> Costs:
    rng = np.random.default_rng(0)
    sizes = rng.uniform(100, 900, 40)
    seconds = sizes[:, None, None] * np.array([[[0.01, 0.02], [0.001, 0.001]]])
    return Costs(("surface-apss", "blank"), ("2048", "512"), seconds, sizes)


def test_costs_of_a_pilot(tmp_path):
    rows = [
        (m, c, o, size, s)
        for o, size in (("a", 10.0), ("b", 20.0))
        for m, c, s in ((GROUND_TRUTH, "", 9.0), ("splat", "2048", size), ("blank", "2048", 1.0))
    ]
    rows.append(("splat", "2048", "c", 30.0, 3.0))  # and no blank
    names = ["method", "condition", "object_id", "size", "seconds"]
    pd.DataFrame(rows, columns=names).to_csv(tmp_path / "samples.csv", index=False)
    found = read_costs(tmp_path / "samples.csv")
    assert (found.methods, found.conditions) == (("splat", "blank"), ("2048",))
    assert found.seconds[:, :, 0].tolist() == [[10.0, 1.0], [20.0, 1.0]]
    assert found.sizes.tolist() == [10.0, 20.0]
    assert read_costs(tmp_path / "samples.csv", ["blank"]).methods == ("blank",)
    with pytest.raises(BadInput, match="no object has a time"):
        read_costs(tmp_path / "samples.csv", ["pc2pix"])


def test_jobs_are_in_the_order_of_the_costs(costs, tmp_path):
    jobs = jobs_of(costs, 2, tmp_path)
    assert [(j.object.object_id, j.condition, j.method) for j in jobs[:5]] == [
        ("test-0000", "2048", "surface-apss"),
        ("test-0000", "2048", "blank"),
        ("test-0000", "512", "surface-apss"),
        ("test-0000", "512", "blank"),
        ("test-0001", "2048", "surface-apss"),
    ]
    assert len({job.key for job in jobs}) == 8


def test_overhead_accounts_for_all_time_of_all_workers():
    # Two workers from 0 to 10: one sleeps 1-4 and 5-9, the other 2-6.
    spans = np.array([[1.0, 4.0], [2.0, 6.0], [5.0, 9.0]])
    found = overhead_of(spans, 11.0, 2, 0.0, 10.0)
    assert found.starting == 1.0 + 2.0
    assert found.tail == (10.0 - 9.0) + (10.0 - 6.0)
    assert found.between == 1.0
    assert found.sleep + found.starting + found.between + found.tail == 20.0


def test_plan_hits_costs_that_go_by_size(costs):
    outcome = costs.seconds.sum()
    for seed in range(5):
        assert planned(costs, range(40), 5, 2, seed).value == pytest.approx(outcome, rel=1e-9)
    even = replace(costs, sizes=np.ones(40))
    assert planned(even, range(40), 5, 2, 0).value != pytest.approx(outcome, rel=1e-3)


def test_sleepers_go_through_the_harness(costs, tmp_path, capsys):
    few = costs.of(np.arange(3))
    simulate(few, 2, 40.0, 3, tmp_path / "run")
    out = capsys.readouterr().out
    assert out.startswith("12 items planned")
    assert "0 lost" in out
    sleep = re.search(r"sleep (\d+) s of a worker", out)
    assert sleep is not None
    assert int(sleep[1]) == round(few.seconds.sum() / 40)
    lines = b"".join(path.read_bytes() for path in (tmp_path / "run/journal").glob("*.jsonl"))
    assert lines.count(b"\n") == 12
