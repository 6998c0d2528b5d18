from __future__ import annotations

import pytest

from bench.records.job import JobTiming, Stopwatch, shares


def test_a_stopwatch_adds_up_and_leaves_the_rest_to_the_harness():
    times = iter([0.0, 1.0, 3.0, 4.0, 4.5, 5.0, 6.0, 10.0])
    watch = Stopwatch(lambda: next(times))  # 0
    with watch.on("methods"):  # 1 to 3
        pass
    with watch.on("metrics"):  # 4 to 4.5
        pass
    with pytest.raises(ZeroDivisionError), watch.on("methods"):  # 5 to 6
        1 / 0  # noqa: B018
    assert watch.timing() == JobTiming(methods=3.0, metrics=0.5, harness=6.5)  # 10


def test_shares_are_of_the_time_that_workers_had():
    done = JobTiming(methods=6.0, metrics=1.0, harness=0.5)
    done += JobTiming(rendering=2.0, harness=0.25)
    assert shares(done, 20.0) == {
        "methods": 0.3,
        "metrics": 0.05,
        "rendering": 0.1,
        "harness": pytest.approx(0.55, abs=1e-15),
    }
    assert shares(JobTiming(), 2.0) == {"methods": 0, "metrics": 0, "rendering": 0, "harness": 1.0}
