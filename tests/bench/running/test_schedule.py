"""The order of jobs, and the budget, with a clock of our own."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from harness_objects import Tetrahedron

from bench.records.job import GROUND_TRUTH, Result, failed
from bench.records.store import open_store
from bench.running.plan import Budget, Schedule, end_s, plan, seconds_of, seeded_turns
from bench.running.pool import submit_all

from ..builders import make_protocol


def plan_of(*names):
    """Five jobs an object: splat at two conditions, blank once for both, and the truth."""
    return plan(make_protocol(objects=tuple(Tetrahedron(*name.split("/")) for name in names)))


def named(job):
    return f"{job.object.object_id} {job.method} {job.condition}".strip()


def done(job):
    return Result(job.key)


@pytest.fixture
def schedule_of(tmp_path):
    """A schedule of objects that keeps its results in one store."""
    with open_store(tmp_path, write=True) as store:

        def make(planned, budget=None, **options):
            return Schedule(planned, store, budget or Budget(), planned.names, **options)

        make.store = store
        yield make


class OneByOne:
    """An executor that ends a job a second, in the order of their coming."""

    def __init__(self, capacity=2, refuse=(), seconds=1.0, clock=None):
        self.capacity, self.waiting, self.order = capacity, [], []
        self.refuse, self.seconds, self.clock = refuse, seconds, clock or [0.0]

    def submit(self, job):
        self.waiting.append(job)
        self.order.append(named(job))

    def wait_any(self, timeout_s=None):
        if timeout_s is not None and timeout_s < self.seconds:
            self.clock[0] += timeout_s
            return
        self.clock[0] += self.seconds
        job = self.waiting.pop(0)
        yield failed(job, "input: no") if named(job) in self.refuse else done(job)

    def close(self):
        pass


def carried_out(schedule, most=1000, **executor):
    worker = OneByOne(**executor)
    for result, _ in zip(
        submit_all(schedule.jobs(), worker, schedule.left_s), range(most), strict=False
    ):
        schedule._store.append(result)
        schedule.take(result)
    return worker.order


def test_objects_follow_each_other_and_truths_come_one_ahead(schedule_of):
    schedule = schedule_of(plan_of("a", "b", "c"))
    assert schedule.left == 12
    assert carried_out(schedule) == [
        *("a ground-truth", "b ground-truth"),
        *("a splat 2048", "a blank 2048", "a splat 512"),
        "c ground-truth",
        *("b splat 2048", "b blank 2048", "b splat 512"),
        *("c splat 2048", "c blank 2048", "c splat 512"),
    ]
    assert [*schedule.complete] == ["chair/a", "chair/b", "chair/c"]
    assert schedule.left == 0


def test_what_is_there_is_not_done_again(schedule_of):
    made = plan_of("a", "b")
    first = schedule_of(made)
    carried_out(first, most=7)
    assert [*first.complete] == ["chair/a"]
    second = schedule_of(made)
    assert [*second.complete] == ["chair/a"]
    assert (second.left, carried_out(second)) == (1, ["b splat 512"])
    assert [*second.complete] == ["chair/a", "chair/b"]
    third = schedule_of(made)
    assert carried_out(third) == []
    assert (third.left, third.scored, third.failures) == (0, 2, 0)
    assert third.working == {GROUND_TRUTH, "splat", "blank"}
    assert third.timing == {}  # of this start


def test_an_object_without_a_ground_truth_is_complete_with_it(schedule_of):
    made = plan_of("a", "b")
    schedule = schedule_of(made)
    order = carried_out(schedule, refuse=("a ground-truth",))
    assert order[:3] == ["a ground-truth", "b ground-truth", "b splat 2048"]
    assert len(order) == 5
    for some in (schedule, schedule_of(made)):
        assert [*some.complete] == ["chair/a", "chair/b"]
        assert (some.scored, some.left, some.failures) == (1, 0, 4)
        assert some.undrawn == "input: no"
    keys = [job.key for job in made[0].jobs]
    results = schedule_of.store.find(keys)
    assert {result.reason for result in results.values()} == {"input: no"}
    assert results.keys() == {*keys}


def test_further_jobs_of_an_object_without_a_ground_truth_have_failed(schedule_of):
    """A run that is extended by a method has its records there, too."""
    schedule = schedule_of(plan_of("a"))
    carried_out(schedule, refuse=("a ground-truth",))
    made = plan(make_protocol(objects=(Tetrahedron("a"),), methods=("splat", "blank", "constant")))
    wider = schedule_of(made)
    assert (wider.left, wider.failures) == (0, 5)
    assert carried_out(wider) == []
    assert len(schedule_of.store.find([job.key for job in made[0].jobs])) == 5


def budgeted(seconds, objects=5, guess_s=4.0, job_s=1.0, capacity=1):
    clock = [0.0]
    budget = Budget(seconds, guess_s, lambda: clock[0])
    with TemporaryDirectory() as folder, open_store(Path(folder), write=True) as store:
        planned = plan_of(*"abcdefgh"[:objects])
        schedule = Schedule(planned, store, budget, planned.names)
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


@pytest.mark.parametrize(
    ("seconds", "job_s", "complete", "ended"),
    [
        (20, 50.0, 0, 20),  # without an object there are no tables to make
        (end_s(1) + 5.5, 1.0, 1, 5.5),  # the second object is begun on the guess
        (end_s(1) + 10.0, 2.0, 1, 10.0),
        (end_s(1) + 7.0, 2.0, 1, 10.0),  # at 10 the first is complete, and its end is late
    ],
)
def test_what_is_under_way_when_the_budget_ends_is_stopped(seconds, job_s, complete, ended):
    names, clock = budgeted(seconds, guess_s=0.0, job_s=job_s, capacity=2)
    assert (len(names), clock) == (complete, ended)


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


@pytest.mark.parametrize(
    ("text", "seconds"), [("90s", 90), ("2m", 120), ("1.5h", 5400), (" 0.5m ", 30)]
)
def test_times(text, seconds):
    assert seconds_of(text) == seconds


CHAIRS = [f"chair/{i:03d}" for i in range(40)]
CARS = [f"car/{i:03d}" for i in range(3)]


def test_classes_take_turns_and_every_object_comes_once():
    order = seeded_turns([*CHAIRS, *CARS], 0)
    assert sorted(order) == sorted([*CHAIRS, *CARS])
    kinds = [name.partition("/")[0] for name in order]
    assert kinds == ["chair", "car"] * 3 + ["chair"] * 37


def test_the_order_depends_on_seed_and_names_alone():
    order = seeded_turns(CHAIRS, 0)
    assert order != CHAIRS
    assert seeded_turns(reversed(CHAIRS), 0) == order
    assert seeded_turns(CHAIRS, 1) != order
    # objects that are added or left out do not change the order of the others
    assert seeded_turns(CHAIRS[:20], 0) == [name for name in order if name in CHAIRS[:20]]
