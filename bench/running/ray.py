"""Jobs on a Ray cluster: an executor whose workers are Ray's (`bench.running.ray_node`).

Ray decides where a job is done, and does the jobs of a lost node again elsewhere. A job that fails,
hangs or ends its process is a result like on one machine, and is not tried again. Only the process
of the run reads and writes its folder: true images come with a job, and its artifact goes back with
the result (about 0.1 MB for 20 views).
"""

from __future__ import annotations

import logging
import os
import socket
import time
from collections import OrderedDict
from collections.abc import Iterator
from contextlib import chdir, contextmanager
from dataclasses import dataclass, replace
from typing import Any

from bench.catalogue.loaders import GPU
from bench.records.job import Job, Result, failed
from bench.running.isolation import QUEUED
from bench.running.options import LOCAL
from bench.running.protocol import Protocol
from bench.running.ray_node import do_on_node, fingerprint_of, requirements
from data_prep.failures import BadInput, MissingDependency

PATIENCE_S = 10.0
COUNTED_EVERY_S = 5.0  # the CPUs of a cluster
NODES_PER_JOB = 5  # lost nodes; then it is the job that takes them down
REFERENCES_KEPT = 64  # true images in the object store; jobs of one object follow each other
STORE_BYTES = 256 * 2**20  # of the object store of a cluster of our own
# Of a GPU, for each job that uses it. On an H200, jobs of 20 images with the networks of metrics
# give 1,900 images a second with one process, 3,260 with two, 4,350 with four, 4,620 with eight and
# 4,680 with sixteen, and each process takes 0.85 GiB of the GPU's memory.
GPU_SHARE = 0.25
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


class RayPool:
    """An executor of jobs on the nodes of a cluster, within `connected`.

    A job is a task, and takes a CPU. Where the cluster has GPUs, it takes a share of one as well,
    if the device is "cuda", which is that of the networks of metrics, too, or if the job is of a
    network and the device is not "cpu".

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
        has_gpu = bool(cluster.gpus) and protocol.device != "cpu"
        self._all_on_gpu = has_gpu and protocol.device == GPU
        networks = (name for name, method in protocol.methods.items() if method.weights_file)
        self._networks = frozenset(networks if has_gpu else ())
        self._cpus, self._counted = cluster.cpus, float("-inf")
        self._message = api.put((requirements(protocol), protocol.suite.limits))
        remote = api.remote(num_cpus=1, max_retries=NODES_PER_JOB, max_calls=0)  # 0: no end
        self._do = remote(do_on_node)
        self._sent: dict[Any, Job] = {}
        self._references: OrderedDict[str, Any] = OrderedDict()

    @property
    def capacity(self) -> int:
        """Return twice the jobs that the workers have in hand: nodes come and go."""
        if time.monotonic() > self._counted + COUNTED_EVERY_S:  # a question to another process
            self._cpus = int(self._ray.cluster_resources().get("CPU", 0))
            self._counted = time.monotonic()
        return QUEUED * max(1, self._cpus)

    def submit(self, job: Job) -> None:
        """Start a job."""
        on_gpu = self._all_on_gpu or job.method in self._networks
        task = self._do.options(num_gpus=GPU_SHARE if on_gpu else 0).remote(
            self._message,
            replace(job, reference=None),
            fingerprint_of(job.object),
            self._reference(job),
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
        self._references.clear()

    def _reference(self, job: Job) -> Any:
        if job.reference_key is None:
            return None
        if job.reference_key not in self._references:
            self._references[job.reference_key] = self._ray.put(job.reference)
            while len(self._references) > REFERENCES_KEPT:
                self._references.popitem(last=False)
        return self._references[job.reference_key]

    def _result(self, task: Any) -> Result:
        """Return the result of a task that has ended."""
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
            reason = f"crash: its node was lost {NODES_PER_JOB + 1} times ({type(error).__name__})"
            return failed(job, reason)
