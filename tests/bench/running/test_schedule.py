"""The order of jobs, and the budget, with a clock of our own."""

from __future__ import annotations

from pathlib import Path

import pytest
from harness_objects import Tetrahedron

from bench.records.job import Result, failed
from bench.running.isolation import submit_all
from bench.running.plan import plan
from bench.running.schedule import Budget, Schedule, end_s, seconds_of
from data_prep.failures import BadInput

from ..builders import make_protocol

HERE = Path("run")


def plan_of(*names):
    """Five jobs an object: splat at two conditions, blank once for both, and the truth."""
    return plan(make_protocol(objects=tuple(Tetrahedron(*name.split("/")) for name in names)), HERE)


def named(job):
    return f"{job.object.object_id} {job.method} {job.condition}".strip()


def done(job):
    return Result(job.key, (), "sha")


class OneByOne:
    """An executor that ends a job a second, in the order of their coming."""

    def __init__(self, capacity=2, refuse=(), seconds=1.0, clock=None):
        self.capacity, self.waiting, self.order = capacity, [], []
        self.refuse, self.seconds, self.clock = refuse, seconds, clock or [0.0]

    def submit(self, job):
        self.waiting.append(job)
        self.order.append(named(job))

    def wait_any(self):
        self.clock[0] += self.seconds
        job = self.waiting.pop(0)
        yield failed(job, "input: no") if named(job) in self.refuse else done(job)

    def close(self):
        pass


def carried_out(schedule, **executor):
    worker = OneByOne(**executor)
    for result in submit_all(schedule.jobs(), worker):
        schedule.take(result)
    return worker.order


def test_objects_follow_each_other_and_truths_come_one_ahead():
    schedule = Schedule(plan_of("a", "b", "c"), {}, Budget())
    assert schedule.left == 12
    assert carried_out(schedule) == [
        *("a ground-truth", "b ground-truth"),
        *("a splat 2048", "a blank 2048", "a splat 512"),
        "c ground-truth",
        *("b splat 2048", "b blank 2048", "b splat 512"),
        *("c splat 2048", "c blank 2048", "c splat 512"),
    ]
    assert schedule.complete == ["chair/a", "chair/b", "chair/c"]
    assert schedule.left == 0


def test_classes_take_turns():
    made = plan_of("a/chair", "b/chair", "c/chair", "d/sofa", "e/table", "f/table")
    assert [obj.name[-1] for obj in made.in_turns] == ["a", "d", "e", "b", "f", "c"]
    assert [obj.name[-1] for obj in made.select({"table/f", "chair/b"}).objects] == ["b", "f"]


def test_what_is_there_is_not_done_again():
    made = plan_of("a", "b")
    first = Schedule(made, {}, Budget())
    carried_out(first)
    kept = {key: first.results[key] for key in list(first.results)[:-1]}
    second = Schedule(made, kept, Budget())
    assert second.complete == ["chair/a"]
    assert (second.left, carried_out(second)) == (1, ["b splat 512"])
    assert second.complete == ["chair/a", "chair/b"]
    assert carried_out(Schedule(made, first.results, Budget())) == []


def test_an_object_without_a_ground_truth_is_complete_with_it():
    schedule = Schedule(plan_of("a", "b"), {}, Budget())
    order = carried_out(schedule, refuse=("a ground-truth",))
    assert order[:3] == ["a ground-truth", "b ground-truth", "b splat 2048"]
    assert len(order) == 5
    assert schedule.complete == ["chair/a", "chair/b"]
    assert schedule.scored == 1
    assert schedule.left == 0


def budgeted(seconds, objects=5, guess_s=4.0, job_s=1.0, capacity=1):
    clock = [0.0]
    schedule = Schedule(
        plan_of(*"abcdefgh"[:objects]), {}, Budget(seconds, guess_s, lambda: clock[0])
    )
    carried_out(schedule, capacity=capacity, seconds=job_s, clock=clock)
    return schedule.complete, clock[0]


def test_no_object_is_begun_that_would_not_fit():
    """An object takes four seconds and a truth ahead; the end what `end_s` says."""
    for complete in (1, 2, 3, 4):
        # When the next is decided about, the last job of the one before is still under way.
        enough = end_s(complete) + 4 * complete + 1
        assert len(budgeted(enough + 1)[0]) == complete
        names, ended = budgeted(enough + 1)
        assert ended + end_s(len(names)) <= enough + 2  # and the truth of the next object
    assert len(budgeted(1000)[0]) == 5


def test_the_first_object_is_done_whatever_it_costs():
    names, ended = budgeted(20, job_s=50.0)
    assert names == ["chair/a"]
    assert ended == 50 * 5  # with the truth of the next


def test_objects_that_take_longer_than_expected_are_left():
    """The second object is begun on the guess that it takes no time, and given up half-way."""
    names, ended = budgeted(end_s(1) + 5.5, guess_s=0.0, capacity=2)
    assert names == ["chair/a"]
    assert ended == 7  # what was under way at 5.5


def test_the_costs_that_count_are_those_of_whole_objects():
    # Loading takes 30 s, the objects 10 and 5: the next is expected to take 10, as does that which
    # is under way.
    for more, allowed in ((0.5, True), (-0.5, False)):
        clock = [0.0]
        budget = Budget(45 + 2 * 10 + end_s(4) + more, 1.0, lambda: clock[0])  # noqa: B023
        for seconds, complete in ((30, False), (4, False), (6, True), (5, True)):
            clock[0] += seconds
            budget.note(complete)
        assert budget.allows(2, 1.0) == allowed


def test_a_budget_too_short_for_one_object_says_how_much_it_takes():
    Budget(None, 1e9).check()
    Budget(60.0, 10.0).check()
    with pytest.raises(BadInput, match=r"--budget 12s: too short for one object .* at least 32s"):
        Budget(12.0, 10.0).check()


@pytest.mark.parametrize(
    ("text", "seconds"), [("90s", 90), ("2m", 120), ("1.5h", 5400), (" 0.5m ", 30)]
)
def test_times(text, seconds):
    assert seconds_of(text) == seconds


@pytest.mark.parametrize(
    "text", ["", "2", "m", "0s", "0.0h", "-2m", "2 m", "2min", "1e3s", "nan", "٢m", "2m30s"]
)
def test_what_is_no_time(text):
    with pytest.raises(BadInput, match=r"--budget .*: give a time over 0 with its unit"):
        seconds_of(text)


def test_objects_come_in_the_given_order_until_there_are_enough():
    schedules = [
        Schedule(plan_of("a", "b", "c"), {}, Budget(), ["chair/c", "chair/a", "chair/b"], enough)
        for enough in (None, lambda: len(schedules[1].complete) >= 2, lambda: True)
    ]
    for schedule in schedules:
        carried_out(schedule)
    assert schedules[0].complete == ["chair/c", "chair/a", "chair/b"]
    # asked once the second is complete, or while it goes on: an object that is begun is finished
    assert schedules[1].complete[:2] == ["chair/c", "chair/a"]
    assert schedules[2].complete == ["chair/c"]  # the first is always done
    assert all(schedule.scored == len(schedule.complete) for schedule in schedules)
