"""Tables of the suite `speed` from samples made by hand."""

from __future__ import annotations

import csv
import io
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.report.figure import spread
from bench.suites.speed.rows import break_even_rows, speed_rows
from bench.suites.speed.samples import CloudFailure, Measurement, TimingSample
from bench.suites.speed.suite import SPEED
from bench.suites.speed.summary import BreakEven, Cost, Statistic, speedups, summarise
from bench.suites.speed.tables import (
    amortised_table,
    break_even_table,
    in_whole_views,
    speed_table,
)

MACHINE = {"cpu": "some cpu", "cores": 2}
SUITE = replace(SPEED, baselines=("slow",), amortised=(1, 4, 8))


def measurement(
    method="slow", prepare=(0.9, 1.0, 5.0), single=(0.1, 0.3, 0.2), batch=0.4, **changes
):
    """Calls of 1 and of 4 views; processor time is twice the clock's; cold calls take 8 s."""
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
SLOW = summarise(measurement())  # 1 + 0.2, and 1 + 0.4 for 4 views
QUICK = summarise(measurement("quick", prepare=(0.1,) * 3, single=(0.2,) * 3, batch=1.0))
NOTHING = dict.fromkeys(("idle_mib", "peak_mib", "elsewhere_cores"))
FAILURES = tuple(CloudFailure(f"chair/{name}", "timeout: too long") for name in "abc")
LOST = summarise(measurement("lost", samples=(), failures=FAILURES, **NOTHING))
ALL = [SLOW, QUICK, LOST]
PAPER = {
    ("all", "picture-ms", "2048", "slow"): 180.0,
    ("all", "picture-ms", "2048", "quick"): 20.0,
    ("all", "picture-speedup", "2048", "quick"): 9.0,
}


def test_medians_in_milliseconds():
    assert {name: statistic.value for name, statistic in SLOW.values.items()} == pytest.approx(
        {
            **dict.fromkeys(("cold-load-ms", "cold-prepare-ms", "cold-draw-ms"), 8000.0),
            "cold-picture-ms": 24000.0,
            "prepare-ms": 1000.0,
            "prepare-p95-ms": 4600.0,  # 0.9 of the way from 1 to 5 s
            "prepare-core-ms": 2000.0,
            "draw-1-ms": 200.0,
            "draw-1-p95-ms": 290.0,
            "draw-1-core-ms": 400.0,
            "draw-4-ms": 100.0,  # a view's share
            "draw-4-p95-ms": 100.0,
            "draw-4-core-ms": 200.0,
            "picture-of-1-ms": 1200.0,
            "picture-of-1-core-ms": 2400.0,
            "picture-of-4-ms": 350.0,
            "picture-of-4-core-ms": 700.0,
            "further-view-ms": 200.0 / 3,  # (0.4 - 0.2) s for three more
            "further-view-core-ms": 400.0 / 3,
            "peak-mib": 75.0,
            "idle-mib": 50.0,
        }
    )
    counts = {name: statistic.n for name, statistic in SLOW.values.items()}
    assert (counts["cold-picture-ms"], counts["prepare-ms"], counts["peak-mib"]) == (1, 3, 1)
    assert (SLOW.wall, SLOW.core) == (Cost(1.0, 0.2, 0.4, 4), Cost(2.0, 0.4, 0.8, 4))


def test_one_view_a_call_has_no_second_batch():
    single = measurement(views=1)
    values = summarise(replace(single, samples=tuple(s for s in single.samples if s.views < 2)))
    assert not [name for name in values.values if "4" in name]
    assert values.wall == Cost(1.0, 0.2, 0.2, 1)


def test_failures():
    assert all(
        math.isnan(statistic.value) and not statistic.n for statistic in LOST.values.values()
    )
    assert (LOST.wall, LOST.core, LOST.n_ok) == (None, None, 0)
    assert LOST.reason == "timeout: too long"
    twice = (CloudFailure("chair/a", "b"), CloudFailure("chair/a", "c"))
    statistic = summarise(measurement(failures=twice))
    assert (statistic.n_ok, statistic.reason) == (2, "b; c")


def test_speedups_are_of_the_rival_over_the_method():
    """1.2 s against 0.3 s alone, 0.35 s against 0.275 s among four."""
    assert speedups(QUICK, SLOW) == {
        "picture-of-1-speedup": Statistic(pytest.approx(4.0), 3),
        "picture-of-4-speedup": Statistic(pytest.approx(0.35 / 0.275), 3),
    }
    assert speedups(QUICK, None) == speedups(LOST, SLOW) == speedups(SLOW, LOST) == {}


def read(table):
    return list(csv.DictReader(io.StringIO(table.to_csv())))


def test_rows_say_all_that_they_were_taken_under():
    rows = read(speed_table(ALL, SUITE, MACHINE, PAPER))
    assert len(rows) == len(speed_rows(ALL, SUITE, PAPER))
    by = {(row["method"], row["metric"]): row for row in rows}
    assert by["slow", "picture-of-1-speedup"]["value"] == "1"
    assert {key: row["paper"] for key, row in by.items() if row["paper"]} == {
        ("slow", "picture-of-4-ms"): "180",
        ("quick", "picture-of-4-ms"): "20",
        ("quick", "picture-of-4-speedup"): "9",
    }
    lost = {(r["n"], r["n_ok"], r["value"], r["reason"]) for r in rows if r["method"] == "lost"}
    assert lost == {("0", "0", "", "timeout: too long")}
    assert by["lost", "prepare-ms"]["elsewhere_cores"] == ""


def method_of(row):
    return row.summary.measurement.method


def test_break_even():
    """1 + 0.1 V against 0.1 + 0.25 V: equal at 6 views."""
    table = break_even_table(ALL, SUITE).to_csv().splitlines()
    assert table[1:] == ["speed,quick,slow,2048,1,up to,6,"]
    both = replace(SUITE, baselines=("slow", "quick", "lost"))
    pairs = [(method_of(r), r.rival, r.break_even.cheaper) for r in break_even_rows(ALL, both)]
    assert pairs == [("slow", "quick", "from"), ("quick", "slow", "up to")]


def test_only_what_was_taken_alike_is_compared():
    faster = summarise(measurement("quick", threads=2))
    other = summarise(measurement("quick", condition="512"))
    assert break_even_rows([SLOW, faster, other], SUITE) == []
    rows = speed_rows([SLOW, faster, other], SUITE, PAPER)
    assert {method_of(r) for r in rows if r.metric.endswith("speedup")} == {"slow"}


@pytest.mark.parametrize(
    ("cheaper", "views", "message"),
    [
        ("always", (), "any"),
        ("never", (), "none"),
        ("up to", (6.5,), "1 to 6"),
        ("up to", (6.0,), "1 to 5"),  # at 6 both cost the same
        ("up to", (1.5,), "1"),
        ("from", (6.5,), "7 and more"),
        ("from", (6.0,), "7 and more"),
        ("between", (2.5, 6.0), "3 to 5"),
        ("between", (2.5, 2.8), "none"),
        ("outside", (2.5, 6.0), "1 to 2, 7 and more"),
    ],
)
def test_verdicts_in_whole_views(cheaper, views, message):
    assert in_whole_views(BreakEven(cheaper, views)) == message


@pytest.mark.parametrize(("cores", "marked"), [(0.25, False), (0.26, True), (None, False)])
def test_times_beside_other_work_are_marked(cores, marked):
    noisy = summarise(measurement("quick", elsewhere_cores=cores))
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
        replace(LOST.measurement, method="splat"),
    ]
    suite = replace(SUITE, baselines=("surface-apss",))
    text = amortised_table([summarise(m) for m in named], suite).to_markdown()
    for line in (
        "| surface-apss | 1200 | 350 | **225** |",
        "| pc2pix | **300** | **275** | 262 |",
        "| blank | 300 | 275 | 262 |",
        "| true-mesh | 1 | 1 | 1 |",
    ):
        assert line in text.splitlines()
    assert "splat" not in text


@given(st.lists(st.floats(0, 1), max_size=8))
def test_labels_keep_their_order_and_their_mean(places):
    moved = spread(places, 0.1)
    order = sorted(range(len(places)), key=lambda i: places[i])
    gaps = np.diff([moved[i] for i in order])
    assert (gaps >= 0.1 - 1e-9).all()
    assert sum(moved) == pytest.approx(sum(places))  # least squares keeps it
