"""Jobs on a Ray cluster: the executor of a run, and what each node of the cluster does.

Ray decides on which node a job is done, and does the jobs of a lost node again on another. A job
that fails, hangs or ends its process gives a failed result, as on one machine, and Ray does not try
it again. Only the process of the run reads and writes the run's folder: a job brings the true
images to its node, and its result brings images and features back (about 0.1 MB for 20 views).
"""

from __future__ import annotations

import json
import logging
import os
import socket
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import chdir, contextmanager, suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from bench.catalogue.loaders import GPU
from bench.catalogue.methods import find_run_method
from bench.catalogue.suites import Limits
from bench.records.job import Job, Result, failed
from bench.running.environment import CODE, code_sha256, environment, versions
from bench.running.options import LOCAL
from bench.running.pool import QUEUED
from bench.running.protocol import Protocol, method_identity, name_of
from bench.running.work import JobPool
from data_prep.datasets.objects import SceneObject
from data_prep.failures import BadInput, MissingDependency
from data_prep.files.checksums import file_sha256

PATIENCE_S = 10.0  # seconds that the address of a cluster may take to accept a connection
_COUNTED_EVERY_S = 5.0  # seconds between two counts of the cluster's CPUs
# How often a job is tried again when its node is lost. After that the job itself is taken to be
# what takes nodes down.
_MOST_RETRIES = 5
# For how many objects the true images in Ray's object store, and the fingerprints, are kept. The
# jobs of an object follow each other, so that few are needed at a time.
KEPT = 64
_STORE_BYTES = 256 * 2**20  # the size of the object store, in bytes, of a cluster started here
# The part of a GPU that a job takes which uses it. On an H200, jobs of 20 images with the networks
# of metrics give 1,900 images a second with one process, 4,350 with four and 4,680 with sixteen,
# and each process takes 0.85 GiB of the GPU's memory: with four there is little left to gain.
_GPU_SHARE = 0.25
_INSTALL = "Ray is not installed; pip install 'pc2pix-bench[ray]'"


@dataclass(frozen=True)
class Cluster:
    """A connection to a cluster, with what all nodes together had when it was made."""

    address: str
    cpus: int
    gpus: int
    nodes: int
    version: str


@contextmanager
def connected(address: str, workers: int) -> Iterator[Cluster]:
    """Yield a connection to the cluster at `address` ("host:port", "auto", "ray://host:port").

    For LOCAL it is a new cluster on this machine with so many workers, which ends with the block.
    Raises MissingDependency where Ray is not installed, and BadInput where no cluster answers.
    """
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # it would send data without being asked
    # Ray leaves CUDA_VISIBLE_DEVICES as it is for jobs that take no GPU, and does not warn of it.
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    try:
        import ray
    except ImportError as error:
        raise MissingDependency(_INSTALL) from error
    local = {"num_cpus": workers, "object_store_memory": _STORE_BYTES, "include_dashboard": False}
    host, _, port = address.removeprefix("ray://").rpartition(":")
    try:
        if host and port.isdecimal():  # where nobody listens, Ray itself would try for minutes
            socket.create_connection((host, int(port)), PATIENCE_S).close()
        # Workers import from the current folder, where a file may be named like a module.
        with chdir("/"):
            ray.init(
                address=address,
                logging_level=logging.ERROR,
                log_to_driver=False,
                **(local if address == LOCAL else {}),
            )
    except (ConnectionError, RuntimeError, ValueError, OSError, OverflowError) as error:
        message = (str(error).strip().splitlines() or [type(error).__name__])[0]
        raise BadInput(
            f"--ray {address}: no cluster answers ({message}); start one with 'ray start --head', "
            f"or give --ray {LOCAL}"
        ) from error
    try:
        resources = ray.cluster_resources()
        cpus, gpus = (int(resources.get(kind, 0)) for kind in ("CPU", "GPU"))
        nodes = sum(node["Alive"] for node in ray.nodes())
        yield Cluster(address, cpus, gpus, nodes, ray.__version__)
    finally:
        ray.shutdown()


class RayPool:
    """An executor of jobs on the nodes of a cluster, within `connected`.

    Each job takes a CPU. Where the cluster has GPUs, some jobs take a share of one as well: with
    the device "cuda" all of them, because metrics use it, too; with "auto" those of methods that
    are networks. Tests pass their own `api` in place of the module `ray`.
    """

    def __init__(self, cluster: Cluster, protocol: Protocol, api: Any = None) -> None:
        if api is None:
            import ray as api
        self._ray = api
        has_gpu = bool(cluster.gpus) and protocol.device != "cpu"
        self._all_on_gpu = has_gpu and protocol.device == GPU
        self._networks: frozenset[str] = frozenset()  # the methods whose jobs take part of a GPU
        if has_gpu:
            methods = protocol.methods.items()
            self._networks = frozenset(name for name, method in methods if method.weights_file)
        self._cpus = cluster.cpus
        self._counted = float("-inf")  # the time of the last count of CPUs
        self._message = api.put((requirements(protocol), protocol.suite.limits))
        # `max_calls=0` is no limit: a process goes on with the networks that it has loaded.
        self._do = api.remote(num_cpus=1, max_retries=_MOST_RETRIES, max_calls=0)(_do_on_node)
        self._put = lru_cache(KEPT)(api.put)
        self._sent: dict[Any, Job] = {}  # the jobs under way, by Ray's reference to the result

    @property
    def capacity(self) -> int:
        """Return how many jobs may be under way: two for each CPU that the cluster has now.

        Nodes come and go, so that the CPUs are counted again from time to time.
        """
        # Not at each call, because counting asks another process.
        if time.monotonic() > self._counted + _COUNTED_EVERY_S:
            self._cpus = int(self._ray.cluster_resources().get("CPU", 0))
            self._counted = time.monotonic()
        return QUEUED * max(1, self._cpus)

    def submit(self, job: Job) -> None:
        """Start a job on the node that Ray chooses."""
        on_gpu = self._all_on_gpu or job.method in self._networks
        task = self._do.options(num_gpus=_GPU_SHARE if on_gpu else 0).remote(
            self._message,
            replace(job, reference=None),
            _fingerprint(job.object),
            None if job.reference is None else self._put(job.reference),
        )
        self._sent[task] = job

    def wait_any(self, timeout_s: float | None = None) -> Iterator[Result]:
        """Wait until jobs have ended, and yield the result of each; none after `timeout_s`."""
        ready, _ = self._ray.wait(
            list(self._sent), num_returns=1, timeout=timeout_s, fetch_local=False
        )
        more, _ = self._ray.wait(list(self._sent), num_returns=len(self._sent), timeout=0)
        for task in dict.fromkeys((*ready, *more)):
            yield self._result(task)

    def close(self) -> None:
        """Stop all jobs that are under way."""
        for task in self._sent:
            self._ray.cancel(task, force=True)
        self._sent.clear()
        self._put.cache_clear()

    def _result(self, task: Any) -> Result:
        """Return the result of a job. Raises MissingDependency where its node cannot work."""
        job, errors = self._sent.pop(task), self._ray.exceptions
        try:
            return self._ray.get(task)
        except (errors.RayTaskError, errors.RaySystemError) as error:
            # The failure of a job is a result, so that this is a failure of its node.
            message = str(error).strip().splitlines()[-1]
            raise MissingDependency(
                f"a node of the cluster cannot work: {message}; set it up like this machine, with "
                "the same packages in the same folders"
            ) from error
        except errors.RayError as error:
            reason = f"crash: its node was lost {_MOST_RETRIES + 1} times ({type(error).__name__})"
            return failed(job, reason)


@dataclass(frozen=True)
class _NodeRequirements:
    """The properties in which a node has to equal the machine that keeps the run's folder."""

    # The versions, checksums and identities by their kind ("versions", "code", ...) and name.
    values: Mapping[str, Mapping[str, str]]
    device: str  # where networks run
    folder: str  # the folder that relative paths start from, where the node has it


def requirements(protocol: Protocol) -> _NodeRequirements:
    """Return the properties of this machine, which all nodes have to share."""
    addresses = [method.address for method in protocol.methods.values()]
    files = [path for _, path in protocol.features]
    values = _properties(protocol.environment, addresses, files, protocol.device)
    return _NodeRequirements(values, protocol.device, str(Path.cwd()))


def mismatch(
    required: _NodeRequirements, probe: Callable[[], Mapping[str, str]] = environment
) -> str:
    """Return in what this machine fails the requirements, with the remedy; "" where it fits.

    Tests pass their own `probe` in place of the question to the graphics driver.
    """
    wanted = required.values
    try:
        here = _properties(probe(), wanted["methods"], wanted["weights"], required.device)
    except MissingDependency as error:
        return str(error)
    for kind, values in wanted.items():
        if differing := [name for name in values if here[kind].get(name) != values[name]]:
            message = ", ".join(f"{n} is {here[kind].get(n)}, not {values[n]}" for n in differing)
            return f"not set up as the machine of the run, {kind}: {message}; make it the same"
    return ""


def _properties(
    machine: Mapping[str, str], addresses: Iterable[str], files: Iterable[str], device: str
) -> dict[str, Mapping[str, str]]:
    """Return what results depend on here, by kind and name, as `_NodeRequirements.values`.

    machine    the environment: driver and libraries
    addresses  of the methods
    files      of the weights
    """

    def identity(address: str) -> str:
        return json.dumps(method_identity(find_run_method(address), device))

    return {
        "environment": machine,
        "versions": versions(),
        "code": {package: code_sha256([package])[:16] for package in CODE},
        "methods": {address: _or_refusal(identity, address) for address in addresses},
        "weights": {
            path: _or_refusal(lambda name: file_sha256(Path(name)), path) for path in files
        },
    }


def _or_refusal(function: Callable[[str], str], name: str) -> str:
    """Return what a function says about a name, or the reason why it cannot.

    Where weights are not here, say, the reason differs from what the other machine says.
    """
    try:
        return function(name)
    except (BadInput, OSError) as error:
        return str(error).removeprefix(f"{name}: ")


class Node:
    """A process of Ray on a node, with a worker process of ours that does jobs one at a time.

    The worker can be killed, as on one machine (`bench.running.pool`).
    """

    def __init__(
        self,
        required: _NodeRequirements,
        limits: Limits,
        probe: Callable[[], Mapping[str, str]] = environment,
    ) -> None:
        with suppress(OSError):  # where it is missing, a relative path is refused when it is opened
            os.chdir(required.folder)
        # Without this check images by another driver, or by another version of a file, would go
        # into the same tables, and nobody would see it.
        self._mismatch = mismatch(required, probe)
        self._pool = JobPool(1, 1, limits)

    def run_job(self, job: Job, fingerprint: str) -> Result:
        """Do a job and return its result.

        fingerprint  the checksum that the job's object has on the machine of the run

        On a node that differs from that machine the result is `unusable`, with the reason.
        """
        problem = self._mismatch
        if not problem and (present := _fingerprint(job.object)) != fingerprint:
            problem = (
                f"{name_of(job.object)} is not what it is in the run ({present[:40]}, not "
                f"{fingerprint[:40]}); put the same dataset into the same folder on all nodes"
            )
        if problem:
            problem = f"node {socket.gethostname()}: {problem}"
            return replace(failed(job, problem), unusable=problem)
        self._pool.submit(job)
        results: list[Result] = []
        while not results:  # a job may take several steps, of which only the last gives its result
            results = list(self._pool.wait_any())
        return results[0]


_node: Node | None = None  # the node that this process belongs to, made at its first job


def _do_on_node(
    message: tuple[_NodeRequirements, Limits], job: Job, fingerprint: str, reference: bytes | None
) -> Result:
    """Do a job in a process of Ray, and return its result.

    message      what the node has to equal, and the limits of a job
    fingerprint  the checksum that the job's object has on the machine of the run
    reference    the packed true images; they are no part of the job, so that Ray sends them to a
                 node once for all jobs of an object
    """
    global _node
    if _node is None:
        _node = Node(*message)
    return _node.run_job(replace(job, reference=reference), fingerprint)


@lru_cache(KEPT)
def _fingerprint(obj: SceneObject) -> str:
    return obj.fingerprint()
