"""Tables of the suite `speed` from samples made by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from bench.suites.speed.measure import SPEED, CloudFailure, Measurement, TimingSample
from bench.suites.speed.tables import (
    amortised_rows,
    amortised_table,
    costs,
    speed_rows,
    speed_table,
    summarise,
)

MACHINE = {"cpu": "some cpu", "cores": 2}
SUITE = replace(SPEED, baselines=("slow",), amortised=(1, 4, 8))


def measurement(
    method="slow", prepare=(0.9, 1.0, 5.0), single=(0.1, 0.3, 0.2), batch=0.4, **changes
):
    """Calls of 1 and of 4 views; processor time is twice the clock's; calls of round 0 take 8 s."""
    warm = [
        *(("prepare", 0, s) for s in prepare),
        *(("draw", 1, s) for s in single),
        *(("draw", 4, batch) for _ in single),
    ]
    samples = [
        *(TimingSample("chair/a", 0, stage, int(stage == "draw"), 8.0, 16.0) for stage in STAGES),
        *(TimingSample("chair/a", 1, stage, views, s, 2 * s) for stage, views, s in warm),
    ]
    result = Measurement(
        *("k", method, "2048"),
        threads=1,
        views=4,
        clouds=3,
        device="cpu",
        samples=tuple(samples),
        failures=(),
        idle_mib=50.0,
        peak_mib=75.0,
        elsewhere_cores=0.0,
    )
    return replace(result, **changes)


STAGES = ("load", "prepare", "draw")
SLOW = measurement()  # 1 + 0.2, and 1 + 0.4 for 4 views
QUICK = measurement("quick", prepare=(0.1,) * 3, single=(0.2,) * 3, batch=1.0)
NOTHING = dict.fromkeys(("idle_mib", "peak_mib", "elsewhere_cores"))
FAILURES = tuple(CloudFailure(f"chair/{name}", "timeout: too long") for name in "abc")
LOST = measurement("lost", samples=(), failures=FAILURES, **NOTHING)
ALL = [SLOW, QUICK, LOST]
PAPER = {
    ("all", "picture-ms", "2048", "slow"): 180.0,
    ("all", "picture-ms", "2048", "quick"): 20.0,
    ("all", "picture-speedup", "2048", "quick"): 9.0,
}


def test_one_view_a_call_has_no_second_batch():
    single = measurement(views=1)
    values = summarise(replace(single, samples=tuple(s for s in single.samples if s.views < 2)))
    # a cloud of 1 s, and calls of 0.2 s
    assert costs(values, "ms", 1, [1, 2, 10]) * [1, 2, 10] == pytest.approx([1200, 1400, 3000])


def test_failures():
    assert all(math.isnan(value) and not n for value, n in summarise(LOST).values())
    assert amortised_rows([LOST], SUITE).empty
    twice = (CloudFailure("chair/a", "b"), CloudFailure("chair/a", "c"))
    row = speed_rows([measurement(failures=twice)], SUITE, MACHINE, {}).iloc[0]
    assert (row["n_ok"], row["reason"]) == (2, "b; c")


def test_speedups_are_of_the_rival_over_the_method():
    """1.2 s against 0.3 s alone, 0.35 s against 0.275 s among four."""
    rows = speed_rows(ALL, SUITE, MACHINE, PAPER).set_index(["method", "metric"])
    for views, faster in ((1, 4.0), (4, 0.35 / 0.275)):
        row = rows.loc[("quick", f"picture-of-{views}-speedup")]
        assert (row["value"], row["n"]) == (pytest.approx(faster), 3)
    assert ("lost", "picture-of-1-speedup") not in rows.index
    of_lost = replace(SUITE, baselines=("lost",))
    assert not speed_rows(ALL, of_lost, MACHINE, PAPER)["metric"].str.endswith("speedup").any()


def test_only_what_was_taken_alike_is_compared():
    faster, other = measurement("quick", threads=2), measurement("quick", condition="512")
    rows = speed_rows([SLOW, faster, other], SUITE, MACHINE, PAPER)
    assert {*rows[rows["metric"].str.endswith("speedup")]["method"]} == {"slow"}


@pytest.mark.parametrize(("cores", "marked"), [(0.25, False), (0.26, True), (None, False)])
def test_times_beside_other_work_are_marked(cores, marked):
    noisy = measurement("quick", elsewhere_cores=cores)
    text = speed_table([SLOW, noisy], SUITE, MACHINE, {}).to_markdown()
    assert ("| quick \\* |" in text) == marked
    assert ("take these times again" in text) == marked
    assert "| slow \\*" not in text


def test_markdown_of_the_amortised():
    """Bold is the cheapest that looks at the cloud alone, and nothing that costs as much."""
    quick = measurement("pc2pix", prepare=(0.1,) * 3, single=(0.2,) * 3, batch=1.0)
    named = [
        measurement("surface-apss"),
        quick,
        replace(quick, method="blank"),
        measurement("true-mesh", prepare=(0.0,), single=(0.001,), batch=0.004),
        replace(LOST, method="splat"),
    ]
    text = amortised_table(amortised_rows(named, SUITE), SUITE, 4).to_markdown()
    for line in (
        "| surface-apss | 1200 | 350 | **225** |",
        "| pc2pix | **300** | **275** | 262 |",
        "| blank | 300 | 275 | 262 |",
        "| true-mesh | 1 | 1 | 1 |",
    ):
        assert line in text.splitlines()
    assert "splat" not in text
