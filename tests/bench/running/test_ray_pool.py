"""The tasks that the jobs of a run become on a cluster. Needs no Ray."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from harness_objects import Tetrahedron

from bench.records.job import Result
from bench.running.pool import submit_all
from bench.running.ray import Cluster, RayPool
from data_prep.failures import MissingDependency

from ..builders import make_job, make_protocol, make_truth

NETWORKS = ("splat-net@chair", "fused-net")


class RayError(Exception):
    pass


class RayTaskError(RayError):
    pass


class OneTaskAtATime:
    """The part of `ray` that a pool uses: a wait ends the first task of those under way.

    `fail` gets the object of a task, and may raise. `tasks` are the shares of a GPU, methods and
    objects of all tasks, in the order of their coming.
    """

    exceptions = SimpleNamespace(
        RayError=RayError, RayTaskError=RayTaskError, RaySystemError=RayTaskError
    )

    def __init__(self, cpus, gpus, fail=lambda obj: None):
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
        def start(message, job, fingerprint, reference):
            assert fingerprint == job.object.fingerprint()
            assert (job.reference, reference) == (None, None if job.reference_key is None else b"")
            self.tasks.append((num_gpus, job.method, job.object.object_id))
            self.jobs.append(job)
            return len(self.tasks) - 1

        return SimpleNamespace(remote=start)

    def wait(self, tasks, num_returns, fetch_local=True, timeout=None):
        assert tasks
        self.most = max(self.most, len(tasks))
        return ([], tasks) if timeout == 0 else (tasks[:1], tasks[1:])

    def get(self, task):
        self.fail(self.tasks[task][2])
        return Result(self.jobs[task].key)


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


@pytest.mark.parametrize(("device", "gpus"), [("auto", 0), ("cpu", 2), ("cuda", 1)])
def test_a_job_is_a_task_and_each_worker_has_a_further_one(device, gpus):
    ray = OneTaskAtATime(cpus=3, gpus=gpus)
    pool = pool_of(ray, device)
    assert pool.capacity == 6
    jobs = jobs_of(NETWORKS[0], range(20))
    assert [result.key for result in submit_all(jobs, pool)] == keys(jobs)
    assert [obj for _, _, obj in ray.tasks] == [str(i) for i in range(20)]
    assert ray.most == 6


def test_a_job_whose_nodes_are_lost_has_failed():
    def fail(obj):
        if obj == "b":
            raise RayError

    jobs = jobs_of(NETWORKS[0], "abc")
    pool = pool_of(OneTaskAtATime(cpus=4, gpus=1, fail=fail))
    results = {result.key: result.reason for result in submit_all(jobs, pool)}
    lost = "crash: its node was lost 6 times (RayError)"
    assert results == dict(zip(keys(jobs), ("", lost, ""), strict=True))


def test_a_node_without_the_packages_ends_the_run():
    def fail(obj):
        raise RayTaskError("Traceback\nModuleNotFoundError: no bench")

    pool = pool_of(OneTaskAtATime(cpus=4, gpus=1, fail=fail))
    with pytest.raises(MissingDependency, match=r"cannot work: ModuleNotFoundError: no bench; set"):
        list(submit_all(jobs_of(NETWORKS[0], "ab"), pool))
