"""Jobs on a Ray cluster: an executor whose workers are Ray's, and the work of a node.

Ray decides where a job is done, and does the jobs of a lost node again elsewhere. A job that fails,
hangs or ends its process is a result like on one machine, and is not tried again. Only the process
of the run reads and writes its folder: true images come with a job, and its artifact goes back with
the result (about 0.1 MB for 20 views). Jobs of networks on a GPU go in batches, several a task.
"""

from __future__ import annotations

import json
import logging
import os
import socket
import time
from collections import OrderedDict
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import chdir, contextmanager, suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from bench.catalogue.loaders import GPU
from bench.catalogue.methods import find_method
from bench.catalogue.suites import Limits
from bench.records.job import Job, Result, failed
from bench.running.environment import code_sha256, environment, versions
from bench.running.executors import JobPool
from bench.running.isolation import QUEUED
from bench.running.options import LOCAL
from bench.running.protocol import Protocol, method_identity
from data_prep.datasets.objects import SceneObject
from data_prep.failures import BadInput, MissingDependency
from data_prep.files.checksums import file_sha256

PACKAGES = ("data_prep", "learning", "baselines", "pc2pix", "bench")


@dataclass(frozen=True)
class NodeRequirements:
    """The properties that a node shares with the machine that keeps the run.

    Attributes
    ----------
    environment : mapping
        The answer of `bench.running.environment.environment`.
    versions : mapping
        Versions of packages.
    code : mapping
        Checksums of this project's packages.
    identities : mapping
        Identities of the methods, see `bench.running.protocol.method_identity`.
    weights : mapping
        Checksums of the files that extractors load.
    device : str
        Where networks run.
    folder : str
        The start of relative paths, where there is such a folder.
    """

    environment: Mapping[str, str]
    versions: Mapping[str, str]
    code: Mapping[str, str]
    identities: Mapping[str, str]
    weights: Mapping[str, str]
    device: str
    folder: str


class Node:
    """A process of Ray's, with the killable process that does its jobs, one at a time."""

    def __init__(
        self,
        requirements: NodeRequirements,
        limits: Limits,
        probe: Callable[[], Mapping[str, str]] = environment,
    ) -> None:
        with suppress(OSError):  # missing: a path that needs it will say so
            os.chdir(requirements.folder)
        # Images of another driver or version of a file would go into the same tables unseen.
        self._mismatch = mismatch(requirements, probe)
        self._pool = JobPool(1, 1, limits)

    def run_job(self, job: Job, fingerprint: str) -> Result:
        """Do a job and return its result.

        `fingerprint` is that of the object on the machine of the run. The result of a node that
        does not meet the requirements, or whose copy of the object differs, is `unusable` and says
        why.
        """
        if mismatch := self._mismatch or _other_object(job.object, fingerprint):
            mismatch = f"node {socket.gethostname()}: {mismatch}"
            return replace(failed(job, mismatch), unusable=mismatch)
        self._pool.submit(job)
        (result,) = self._pool.wait_any()
        return result


_node: Node | None = None  # of this process, where it is one of Ray's


def do_on_node(
    message: tuple[NodeRequirements, Limits],
    jobs: Sequence[tuple[Job, str]],
    *references: bytes | None,
) -> list[Result]:
    """Do jobs on the node that this process is, one by one; Ray calls this for each task.

    `jobs` come with the fingerprints of their objects. `references` are the true images of each,
    which Ray sends once for the jobs of an object.
    """
    global _node
    if _node is None:
        _node = Node(*message)
    return [
        _node.run_job(replace(job, reference=reference), fingerprint)
        for (job, fingerprint), reference in zip(jobs, references, strict=True)
    ]


def requirements(protocol: Protocol) -> NodeRequirements:
    """Return the properties of this machine, which all nodes have to share."""
    return NodeRequirements(
        environment=protocol.environment,
        versions=versions(),
        code=_code(),
        identities=_identities(protocol.methods, protocol.device),
        weights={path: _sum(path) for _, path in protocol.features},
        device=protocol.device,
        folder=str(Path.cwd()),
    )


def mismatch(
    requirements: NodeRequirements, probe: Callable[[], Mapping[str, str]] = environment
) -> str:
    """Return how this machine fails the requirements, with the remedy; empty where it does not.

    `probe` finds out the environment.
    """
    try:
        here = probe()
    except MissingDependency as error:
        return str(error)
    for kind, present, wanted in (
        ("environment", here, requirements.environment),
        ("versions", versions(), requirements.versions),
        ("code", _code(), requirements.code),
        (
            "methods",
            _identities(requirements.identities, requirements.device),
            requirements.identities,
        ),
        ("weights", {path: _sum(path) for path in requirements.weights}, requirements.weights),
    ):
        if differing := [name for name in wanted if present.get(name) != wanted[name]]:
            message = ", ".join(f"{n} is {present.get(n)}, not {wanted[n]}" for n in differing)
            return f"not set up as the machine of the run, {kind}: {message}; make it the same"
    return ""


def _other_object(obj: SceneObject, fingerprint: str) -> str:
    present = fingerprint_of(obj)
    if present == fingerprint:
        return ""
    return (
        f"{obj.class_name}/{obj.object_id} is not what it is in the run ({present[:40]}, not "
        f"{fingerprint[:40]}); put the same dataset into the same folder on all nodes"
    )


@lru_cache(maxsize=64)
def fingerprint_of(obj: SceneObject) -> str:
    """Return the fingerprint of an object, read once for its jobs, which follow each other."""
    return obj.fingerprint()


def _code() -> dict[str, str]:
    """Return a checksum for each package of this project."""
    return {package: code_sha256([package])[:16] for package in PACKAGES}


def _identities(methods: Iterable[str], device: str) -> dict[str, str]:
    identities = {}
    for method in methods:
        try:
            identities[method] = json.dumps(method_identity(find_method(method), device))
        except BadInput as error:  # its weights are not here
            identities[method] = str(error)
    return identities


def _sum(path: str) -> str:
    try:
        return file_sha256(Path(path))
    except (BadInput, OSError) as error:
        return str(error).removeprefix(f"{path}: ")


PATIENCE_S = 10.0
COUNTED_EVERY_S = 5.0  # the CPUs of a cluster
NODES_PER_JOB = 5  # lost nodes; then it is the job that takes them down
REFERENCES_KEPT = 64  # true images in the object store; jobs of one object follow each other
STORE_BYTES = 256 * 2**20  # of the object store of a cluster of our own
# Of a GPU, for each task that uses it. On an H200, jobs of 20 images with the networks of metrics
# give 1,900 images a second with one process, 3,260 with two, 4,350 with four, 4,620 with eight and
# 4,680 with sixteen, and each process takes 0.85 GiB of the GPU's memory.
GPU_SHARE = 0.25
BATCH_JOBS = 8  # most jobs of a network in a task on a GPU, where 20 images take some 20 ms
INSTALL = "Ray is not installed; pip install 'pc2pix-bench[ray]'"


@dataclass(frozen=True)
class Cluster:
    """A connection to a cluster, with the CPUs and GPUs of all nodes when it was made."""

    address: str
    cpus: int
    gpus: int
    nodes: int
    version: str


@contextmanager
def connected(address: str, workers: int) -> Iterator[Cluster]:
    """Yield a connection to the cluster at `address` ("host:port", "auto", "ray://host:port").

    For LOCAL it is a new cluster on this machine with so many workers, which ends with the block.
    Raises MissingDependency without Ray, and BadInput where no cluster answers.
    """
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # nobody was asked
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    try:
        import ray
    except ImportError as error:
        raise MissingDependency(INSTALL) from error
    _check_reachable(address)
    local = {"num_cpus": workers, "object_store_memory": STORE_BYTES, "include_dashboard": False}
    try:
        with chdir("/"):  # workers would import from the current folder: a `random.py`, say
            ray.init(
                address=address,
                logging_level=logging.ERROR,
                log_to_driver=False,
                **(local if address == LOCAL else {}),
            )
    except (ConnectionError, RuntimeError, ValueError, OSError) as error:
        message = (str(error).strip().splitlines() or [type(error).__name__])[0]
        raise _no_cluster(address, message) from error
    try:
        resources = ray.cluster_resources()
        cpus, gpus = (int(resources.get(kind, 0)) for kind in ("CPU", "GPU"))
        nodes = sum(node["Alive"] for node in ray.nodes())
        yield Cluster(address, cpus, gpus, nodes, ray.__version__)
    finally:
        ray.shutdown()


def _check_reachable(address: str) -> None:
    """Raise BadInput where nobody listens at "host:port"."""
    # Ray would ask for minutes.
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if not (host and port.isdecimal()):
        return
    try:
        socket.create_connection((host, int(port)), PATIENCE_S).close()
    except (OSError, OverflowError) as error:
        raise _no_cluster(address, str(error)) from error


def _no_cluster(address: str, message: str) -> BadInput:
    return BadInput(
        f"--ray {address}: no cluster answers ({message}); start one with 'ray start --head', or "
        f"give --ray {LOCAL}"
    )


class JobBatches:
    """Jobs that wait to be sent together with others of their method."""

    def __init__(self) -> None:
        self._by_method: dict[str, list[Job]] = {}

    def __bool__(self) -> bool:
        return bool(self._by_method)

    def add(self, job: Job) -> None:
        """Let a job wait."""
        self._by_method.setdefault(job.method, []).append(job)

    def take(self) -> list[Job]:
        """Remove the jobs of the next method in turn, at most BATCH_JOBS, and return them."""
        method = next(iter(self._by_method))
        jobs = self._by_method.pop(method)
        if len(jobs) > BATCH_JOBS:
            self._by_method[method] = jobs[BATCH_JOBS:]
        return jobs[:BATCH_JOBS]


def gpu_workers(cpus: int, gpus: int) -> int:
    """Return how many tasks on GPUs can be under way at once: each takes a CPU as well."""
    return min(cpus, int(gpus / GPU_SHARE))


def networks_on_gpu(cluster: Cluster, protocol: Protocol) -> frozenset[str]:
    """Return the methods whose jobs take a share of a GPU to draw, and go in batches."""
    if not cluster.gpus or protocol.device == "cpu":
        return frozenset()
    return frozenset(name for name, method in protocol.methods.items() if method.weights_file)


def capacity_of(cpus: int, gpus: int, batched: Collection[str]) -> int:
    """Return how many jobs keep all workers of a cluster busy; those of `batched` in batches."""
    batches = gpu_workers(cpus, gpus) if batched else 0
    return QUEUED * max(1, cpus + BATCH_JOBS * batches)


class RayPool:
    """An executor of jobs on the nodes of a cluster, within `connected`.

    A task takes a CPU. Where the cluster has GPUs, it takes a share of one as well, if the device
    is "cuda", which is that of the networks of metrics, too, or if the task is of a network and
    the device is not "cpu". Jobs of a network with a share of a GPU are sent in batches: all that
    wait for it when a worker is about to become free. Others are a task each.

    Parameters
    ----------
    cluster : Cluster
    protocol : Protocol
    api : module, optional
        Stands in for `ray`.
    """

    def __init__(self, cluster: Cluster, protocol: Protocol, api: Any = None) -> None:
        if api is None:
            import ray as api
        self._ray = api
        self._batched = networks_on_gpu(cluster, protocol)
        self._all_on_gpu = bool(cluster.gpus) and protocol.device == GPU
        self._cpus, self._gpus, self._counted = cluster.cpus, cluster.gpus, float("-inf")
        self._message = api.put((requirements(protocol), protocol.suite.limits))
        remote = api.remote(num_cpus=1, max_retries=NODES_PER_JOB, max_calls=0)  # 0: no end
        self._do = remote(do_on_node)
        self._batches = JobBatches()
        self._sent: dict[Any, list[Job]] = {}
        self._references: OrderedDict[str, Any] = OrderedDict()

    @property
    def capacity(self) -> int:
        """Return twice the jobs that the workers have in hand: nodes come and go."""
        if time.monotonic() > self._counted + COUNTED_EVERY_S:  # a question to another process
            resources = self._ray.cluster_resources()
            self._cpus, self._gpus = (int(resources.get(kind, 0)) for kind in ("CPU", "GPU"))
            self._counted = time.monotonic()
        return capacity_of(self._cpus, self._gpus, self._batched)

    def submit(self, job: Job) -> None:
        """Start a job, or let it wait for others of its batch until `wait_any`."""
        if job.method in self._batched:
            self._batches.add(job)
        else:
            self._send([job])

    def wait_any(self) -> Iterator[Result]:
        """Wait until jobs have ended, and yield the result of each."""
        # No job is left waiting while a GPU has nothing to do, so that the end of a run and of an
        # object need no rule of their own; and with all GPUs at work, batches grow.
        under_way = sum(jobs[0].method in self._batched for jobs in self._sent.values())
        most = QUEUED * max(1, gpu_workers(self._cpus, self._gpus))
        while self._batches and under_way < most:
            self._send(self._batches.take())
            under_way += 1
        ready, _ = self._ray.wait(list(self._sent), num_returns=1, fetch_local=False)
        more, _ = self._ray.wait(list(self._sent), num_returns=len(self._sent), timeout=0)
        for task in dict.fromkeys((*ready, *more)):
            yield from self._results(task)

    def close(self) -> None:
        """Stop all jobs that are under way."""
        for task in self._sent:
            self._ray.cancel(task, force=True)
        self._sent.clear()
        self._references.clear()

    def _send(self, jobs: list[Job]) -> None:
        on_gpu = self._all_on_gpu or jobs[0].method in self._batched
        task = self._do.options(num_gpus=GPU_SHARE if on_gpu else 0).remote(
            self._message,
            [(replace(job, reference=None), fingerprint_of(job.object)) for job in jobs],
            *map(self._reference, jobs),  # each an argument: Ray looks into no list for references
        )
        self._sent[task] = jobs

    def _reference(self, job: Job) -> Any:
        if job.reference_key is None:
            return None
        if job.reference_key not in self._references:
            self._references[job.reference_key] = self._ray.put(job.reference)
            while len(self._references) > REFERENCES_KEPT:
                self._references.popitem(last=False)
        return self._references[job.reference_key]

    def _results(self, task: Any) -> Iterator[Result]:
        """Yield the results of a task that has ended."""
        jobs, errors = self._sent.pop(task), self._ray.exceptions
        try:
            results = self._ray.get(task)
        except (errors.RayTaskError, errors.RaySystemError) as error:
            # Not of a job, whose failures are results.
            message = str(error).strip().splitlines()[-1]
            raise MissingDependency(
                f"a node of the cluster cannot work: {message}; set it up like this machine, with "
                "the same packages in the same folders"
            ) from error
        except errors.RayError as error:
            if len(jobs) > 1:  # one of them may take nodes down: the others are not to fail with it
                for job in jobs:
                    self._send([job])
                return
            reason = f"crash: its node was lost {NODES_PER_JOB + 1} times ({type(error).__name__})"
            results = [failed(jobs[0], reason)]
        yield from results
