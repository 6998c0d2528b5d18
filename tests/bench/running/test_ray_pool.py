"""The tasks that the jobs of a run become on a cluster. Needs no Ray."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from harness_objects import Tetrahedron

from bench.records.job import Result
from bench.records.store import open_store
from bench.running.isolation import submit_all
from bench.running.plan import plan
from bench.running.ray import BATCH_JOBS, Cluster, RayPool
from bench.running.schedule import Budget, Schedule
from data_prep.failures import MissingDependency

from ..builders import make_job, make_protocol, make_truth

NETWORKS = ("splat-net@chair", "fused-net")


class RayError(Exception):
    pass


class RayTaskError(RayError):
    pass


class OneTaskAtATime:
    """The part of `ray` that a pool uses: a wait ends the first task of those under way.

    `fail` gets the objects of a task, and may raise. `tasks` are the shares of a GPU, methods and
    objects of all tasks, in the order of their coming.
    """

    exceptions = SimpleNamespace(
        RayError=RayError, RayTaskError=RayTaskError, RaySystemError=RayTaskError
    )

    def __init__(self, cpus, gpus, fail=lambda objects: None):
        self.resources, self.fail = {"CPU": float(cpus), "GPU": float(gpus)}, fail
        self.tasks, self.jobs, self.most = [], [], 0

    def cluster_resources(self):
        return self.resources

    def put(self, value):
        return value

    def remote(self, num_cpus, max_retries, max_calls):
        assert (num_cpus, max_retries, max_calls) == (1, 5, 0)
        return lambda function: self

    def options(self, num_gpus):
        def start(message, jobs, *references):
            assert len(references) == len(jobs)
            (method,) = {job.method for job, _ in jobs}
            self.tasks.append((num_gpus, method, [job.object.object_id for job, _ in jobs]))
            self.jobs.append([job for job, _ in jobs])
            return len(self.tasks) - 1

        return SimpleNamespace(remote=start)

    def wait(self, tasks, num_returns, fetch_local=True, timeout=None):
        assert tasks
        self.most = max(self.most, len(tasks))
        return ([], tasks) if timeout == 0 else (tasks[:1], tasks[1:])

    def get(self, task):
        self.fail(self.tasks[task][2])
        return [Result(job.key, (), "sha") for job in self.jobs[task]]


def pool_of(ray, device="auto", methods=(*NETWORKS, "blank"), **changes):
    cpus, gpus = (int(ray.resources[kind]) for kind in ("CPU", "GPU"))
    protocol = make_protocol(device=device, methods=methods, **changes)
    return RayPool(Cluster("auto", cpus, gpus, 1, "2"), protocol, ray)


def jobs_of(method, objects):
    return [make_job(Tetrahedron(str(obj)), method, reference=b"") for obj in objects]


def keys(jobs):
    return [job.key for job in jobs]


@pytest.mark.parametrize(
    ("device", "gpus", "of_networks", "of_others"),
    [
        ("auto", 1, 0.25, 0),
        ("cuda", 1, 0.25, 0.25),  # their images are measured by networks
        ("cpu", 1, 0, 0),
        ("auto", 0, 0, 0),
        ("cuda", 0, 0, 0),  # no task would ever begin: a node says that it has no GPU
    ],
)
def test_what_computes_on_a_gpu_takes_a_quarter_of_one(device, gpus, of_networks, of_others):
    ray = OneTaskAtATime(cpus=4, gpus=gpus)
    jobs = [*jobs_of(NETWORKS[0], "a"), *jobs_of("blank", "a"), make_truth()]
    assert len([*submit_all(jobs, pool_of(ray, device))]) == 3
    shares = {method: share for share, method, _ in ray.tasks}
    others = {"blank": of_others, "ground-truth": of_others}
    assert shares == {NETWORKS[0]: of_networks} | others


def test_batches_are_full_as_long_as_there_are_jobs():
    # Four of 20 CPUs work on the GPU, with a batch each and one that waits on the node.
    ray = OneTaskAtATime(cpus=20, gpus=1)
    pool = pool_of(ray)
    assert pool.capacity == 2 * 20 + 2 * 4 * BATCH_JOBS
    jobs = jobs_of(NETWORKS[0], range(300))
    assert [result.key for result in submit_all(jobs, pool)] == keys(jobs)  # each once
    assert [len(objects) for _, _, objects in ray.tasks] == [BATCH_JOBS] * 37 + [4]
    assert ray.most == 8


def test_a_batch_is_of_one_method_and_waits_for_nothing_that_does_not_come():
    ray = OneTaskAtATime(cpus=4, gpus=1)
    first, second = (jobs_of(method, "abc") for method in NETWORKS)
    mixed = [job for pair in zip(first, second, strict=True) for job in pair]
    blanks = jobs_of("blank", "ab")
    found = [result.key for result in submit_all((*mixed, None, *blanks), pool_of(ray))]
    assert sorted(found) == sorted(keys((*mixed, *blanks)))
    assert ray.tasks == [
        (0.25, NETWORKS[0], ["a", "b", "c"]),
        (0.25, NETWORKS[1], ["a", "b", "c"]),
        (0, "blank", ["a"]),
        (0, "blank", ["b"]),
    ]


@pytest.mark.parametrize(("device", "gpus"), [("auto", 0), ("cpu", 2)])
def test_on_cpus_a_job_is_a_task(device, gpus):
    ray = OneTaskAtATime(cpus=3, gpus=gpus)
    pool = pool_of(ray, device)
    assert pool.capacity == 6
    jobs = jobs_of(NETWORKS[0], range(20))
    assert [result.key for result in submit_all(jobs, pool)] == keys(jobs)
    assert [objects for _, _, objects in ray.tasks] == [[str(i)] for i in range(20)]
    assert ray.most == 6


@pytest.mark.parametrize(("ahead", "largest"), [(1, 2), (18, BATCH_JOBS)])
def test_batches_have_jobs_of_several_objects_where_truths_are_ahead(tmp_path, ahead, largest):
    """An object has two jobs of a network, which is all that is known with one truth ahead."""
    ray = OneTaskAtATime(cpus=4, gpus=1)
    protocol = {"methods": (NETWORKS[0], "blank"), "device": "auto"}
    planned = plan(make_protocol(objects=tuple(map(Tetrahedron, map(str, range(40)))), **protocol))
    with open_store(tmp_path, write=True) as store:
        schedule = Schedule(planned, store, Budget(), ahead=ahead)
        for result in submit_all(schedule.jobs(), pool_of(ray, **protocol)):
            store.append(result)
            schedule.take(result)
    assert (schedule.left, len(schedule.complete)) == (0, 40)
    sizes = [len(objects) for _, method, objects in ray.tasks if method == NETWORKS[0]]
    assert (sum(sizes), max(sizes)) == (80, largest)


def test_the_jobs_of_a_batch_whose_nodes_are_lost_are_sent_one_by_one():
    def fail(objects):
        if "b" in objects:
            raise RayError

    ray = OneTaskAtATime(cpus=4, gpus=1, fail=fail)
    jobs = jobs_of(NETWORKS[0], "abc")
    results = {result.key: result.reason for result in submit_all(jobs, pool_of(ray))}
    lost = "crash: its node was lost 6 times (RayError)"
    assert results == dict(zip(keys(jobs), ("", lost, ""), strict=True))
    assert [objects for _, _, objects in ray.tasks] == [["a", "b", "c"], ["a"], ["b"], ["c"]]


def test_a_node_without_the_packages_ends_the_run():
    def fail(objects):
        raise RayTaskError("Traceback\nModuleNotFoundError: no bench")

    pool = pool_of(OneTaskAtATime(cpus=4, gpus=1, fail=fail))
    with pytest.raises(MissingDependency, match=r"cannot work: ModuleNotFoundError: no bench; set"):
        list(submit_all(jobs_of(NETWORKS[0], "ab"), pool))
