"""Jobs on a Ray cluster: an executor whose workers are Ray's, and what these do.

Ray decides where a job is done, and does the jobs of a lost node again elsewhere. A job that fails,
hangs or ends its process is a result like on one machine, and is not tried again. Only the process
of the run reads and writes its folder: true images come with a job, and its artifact goes back with
the result (about 0.1 MB for 20 views).
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

PATIENCE_S = 10.0
_COUNTED_EVERY_S = 5.0  # the CPUs of a cluster
_NODES_PER_JOB = 5  # lost nodes; then it is the job that takes them down
KEPT = 64  # true images in the object store, and fingerprints: jobs of one object follow each other
_STORE_BYTES = 256 * 2**20  # of the object store of a cluster of our own
# Of a GPU, for each job that uses it. On an H200, jobs of 20 images with the networks of metrics
# give 1,900 images a second with one process, 4,350 with four and 4,680 with sixteen, and each
# process takes 0.85 GiB of the GPU's memory.
_GPU_SHARE = 0.25
_INSTALL = "Ray is not installed; pip install 'pc2pix-bench[ray]'"


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
    """
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # nobody was asked
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    try:
        import ray
    except ImportError as error:
        raise MissingDependency(_INSTALL) from error
    local = {"num_cpus": workers, "object_store_memory": _STORE_BYTES, "include_dashboard": False}
    host, _, port = address.removeprefix("ray://").rpartition(":")
    try:
        if host and port.isdecimal():  # where nobody listens, Ray would ask for minutes
            socket.create_connection((host, int(port)), PATIENCE_S).close()
        with chdir("/"):  # workers would import from the current folder: a `random.py`, say
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

    A job takes a CPU. Where the cluster has GPUs, it takes a share of one as well, if the device is
    "cuda", which is that of the networks of metrics, too, or if it is of a network and the device
    is not "cpu". `api` stands in for `ray`.
    """

    def __init__(self, cluster: Cluster, protocol: Protocol, api: Any = None) -> None:
        if api is None:
            import ray as api
        self._ray = api
        has_gpu = bool(cluster.gpus) and protocol.device != "cpu"
        self._all_on_gpu = has_gpu and protocol.device == GPU
        networks = (name for name, method in protocol.methods.items() if method.weights_file)
        self._networks = frozenset(networks if has_gpu else ())
        self._cpus, self._counted = cluster.cpus, float("-inf")
        self._message = api.put((requirements(protocol), protocol.suite.limits))
        # Without `max_calls` a process keeps what it has loaded.
        self._do = api.remote(num_cpus=1, max_retries=_NODES_PER_JOB, max_calls=0)(_do_on_node)
        self._put = lru_cache(KEPT)(api.put)
        self._sent: dict[Any, Job] = {}

    @property
    def capacity(self) -> int:
        """Return twice the jobs that the workers have in hand: nodes come and go."""
        if time.monotonic() > self._counted + _COUNTED_EVERY_S:  # a question to another process
            self._cpus = int(self._ray.cluster_resources().get("CPU", 0))
            self._counted = time.monotonic()
        return QUEUED * max(1, self._cpus)

    def submit(self, job: Job) -> None:
        """Start a job."""
        on_gpu = self._all_on_gpu or job.method in self._networks
        task = self._do.options(num_gpus=_GPU_SHARE if on_gpu else 0).remote(
            self._message,
            replace(job, reference=None),
            _fingerprint(job.object),
            None if job.reference is None else self._put(job.reference),
        )
        self._sent[task] = job

    def wait_any(self, timeout_s: float | None = None) -> Iterator[Result]:
        """Wait until jobs have ended, and yield the result of each; nothing after `timeout_s`."""
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
        job, errors = self._sent.pop(task), self._ray.exceptions
        try:
            return self._ray.get(task)
        except (errors.RayTaskError, errors.RaySystemError) as error:
            # Not of a job, whose failures are results.
            message = str(error).strip().splitlines()[-1]
            raise MissingDependency(
                f"a node of the cluster cannot work: {message}; set it up like this machine, with "
                "the same packages in the same folders"
            ) from error
        except errors.RayError as error:
            reason = f"crash: its node was lost {_NODES_PER_JOB + 1} times ({type(error).__name__})"
            return failed(job, reason)


@dataclass(frozen=True)
class _NodeRequirements:
    """The properties that a node shares with the machine that keeps the run."""

    values: Mapping[str, Mapping[str, str]]  # versions, checksums, identities, by kind and name
    device: str  # where networks run
    folder: str  # the start of relative paths, where there is such a folder


def requirements(protocol: Protocol) -> _NodeRequirements:
    """Return the properties of this machine, which all nodes have to share."""
    addresses = [method.address for method in protocol.methods.values()]
    files = [path for _, path in protocol.features]
    values = _properties(protocol.environment, addresses, files, protocol.device)
    return _NodeRequirements(values, protocol.device, str(Path.cwd()))


def mismatch(
    required: _NodeRequirements, probe: Callable[[], Mapping[str, str]] = environment
) -> str:
    """Return how this machine fails the requirements, with the remedy; empty where it does not."""
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
    """Return what a function says about a name, or why it cannot: weights that are not here."""
    try:
        return function(name)
    except (BadInput, OSError) as error:
        return str(error).removeprefix(f"{name}: ")


class Node:
    """A process of Ray's, with the killable process that does its jobs, one at a time."""

    def __init__(
        self,
        required: _NodeRequirements,
        limits: Limits,
        probe: Callable[[], Mapping[str, str]] = environment,
    ) -> None:
        with suppress(OSError):  # missing: a path that needs it will say so
            os.chdir(required.folder)
        # Images of another driver or version of a file would go into the same tables unseen.
        self._mismatch = mismatch(required, probe)
        self._pool = JobPool(1, 1, limits)

    def run_job(self, job: Job, fingerprint: str) -> Result:
        """Do a job and return its result, which is `unusable` on a node that must not do it.

        `fingerprint` is that of the object on the machine of the run.
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
        while not (results := [*self._pool.wait_any()]):
            pass  # a job may take several steps
        return results[0]


_node: Node | None = None  # of this process, where it is one of Ray's


def _do_on_node(
    message: tuple[_NodeRequirements, Limits], job: Job, fingerprint: str, reference: bytes | None
) -> Result:
    """Do a job on this node, with the true images, which Ray sends once for an object."""
    global _node
    if _node is None:
        _node = Node(*message)
    return _node.run_job(replace(job, reference=reference), fingerprint)


@lru_cache(KEPT)
def _fingerprint(obj: SceneObject) -> str:
    return obj.fingerprint()
