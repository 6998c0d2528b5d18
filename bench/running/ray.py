"""Jobs on a Ray cluster: an executor (`bench.running.executor`) whose workers are Ray's.

Ray decides where a job is done, and does those of a lost node again elsewhere; nothing else is left
to it. A job that fails, hangs or takes its process down is a result like on one machine
(`bench.running.ray_node`), and is not tried again. Jobs and results are plain values of some kB; of
a run's files none has to be reachable from the nodes, and nothing but this process writes into its
folder.
"""

from __future__ import annotations

import logging
import os
import socket
import time
from collections import OrderedDict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bench.catalogue.methods import find_method
from bench.records.record import GROUND_TRUTH
from bench.running.isolation import Limits
from bench.running.ray_node import Demands, do_on_node, fingerprint_of
from bench.running.work import Job, Result, failed
from data_prep.failures import BadInput, CannotWrite, MissingDependency
from data_prep.whole_files import write_whole

LOCAL = "local"
PATIENCE_S = 10.0
COUNTED_EVERY_S = 5.0  # the CPUs of a cluster
NODES_PER_JOB = 5  # lost ones; then it is the job that takes them down
REFERENCES_KEPT = 64  # true pictures in the object store; jobs of one object follow each other
STORE_BYTES = 256 * 2**20  # of the object store of a cluster of our own
INSTALL = "Ray is not installed; pip install 'pc2pix-bench[ray]'"


@dataclass(frozen=True)
class Cluster:
    """A connection. `cpus` and `gpus` are those of all nodes when it was made."""

    address: str
    cpus: int
    gpus: int
    nodes: int
    version: str


@contextmanager
def connected(address: str, workers: int) -> Iterator[Cluster]:
    """A connection to the cluster at `address` ("host:port", "auto", "ray://host:port"), or, for
    LOCAL, to one on this machine with so many workers, which ends with the block.

    Raises MissingDependency without Ray, and BadInput where no cluster answers.
    """
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # nobody was asked
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    try:
        import ray
    except ImportError as error:
        raise MissingDependency(INSTALL) from error
    _knock(address)
    own = {"num_cpus": workers, "object_store_memory": STORE_BYTES, "include_dashboard": False}
    try:
        ray.init(
            address=address,
            logging_level=logging.ERROR,
            log_to_driver=False,
            **(own if address == LOCAL else {}),
        )
    except (ConnectionError, RuntimeError, ValueError, OSError) as error:
        told = (str(error).strip().splitlines() or [type(error).__name__])[0]
        raise _no_cluster(address, told) from error
    try:
        there = ray.cluster_resources()
        nodes = sum(node["Alive"] for node in ray.nodes())
        yield Cluster(
            address, int(there.get("CPU", 0)), int(there.get("GPU", 0)), nodes, ray.__version__
        )
    finally:
        ray.shutdown()


def _knock(address: str) -> None:
    """Raises BadInput where nobody listens at "host:port": Ray would ask for minutes."""
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if not (host and port.isdecimal()):
        return
    try:
        socket.create_connection((host, int(port)), PATIENCE_S).close()
    except (OSError, OverflowError) as error:
        raise _no_cluster(address, str(error)) from error


def _no_cluster(address: str, told: str) -> BadInput:
    return BadInput(
        f"--ray {address}: no cluster answers ({told}); start one with 'ray start --head', or give "
        f"--ray {LOCAL}"
    )


class RayPool:
    """Does jobs on the nodes of a cluster, an executor. To be made within `connected`.

    A CPU each; a GPU as well for a network, where the cluster has any and the device is not "cpu".
    """

    def __init__(self, cluster: Cluster, limits: Limits, demands: Demands) -> None:
        import ray

        self._gpus = cluster.gpus
        self._room, self._counted = 0, float("-inf")
        self._told = ray.put((demands, limits))
        remote = ray.remote(num_cpus=1, max_retries=NODES_PER_JOB, max_calls=0)  # 0: no end
        self._do = remote(do_on_node)
        self._waiting: dict[Any, Job] = {}
        self._references: OrderedDict[Path, Any] = OrderedDict()

    @property
    def room(self) -> int:
        """Two jobs for each CPU that the cluster has now: nodes come and go."""
        import ray

        if time.monotonic() > self._counted + COUNTED_EVERY_S:  # a question to another process
            self._room = max(2, 2 * int(ray.cluster_resources().get("CPU", 0)))
            self._counted = time.monotonic()
        return self._room

    def submit(self, job: Job) -> None:
        """Have a job done. Raises OSError where its ground truth cannot be read."""
        reference = None if job.reference is None else self._reference(job.reference)
        gpus = 1 if self._gpus and _wants_gpu(job) else 0
        ref = self._do.options(num_gpus=gpus).remote(
            self._told, job, fingerprint_of(job.object), reference
        )
        self._waiting[ref] = job

    def collect(self) -> Iterator[Result]:
        """Wait until jobs have ended; the result of each, its artifact written."""
        import ray

        ready, _ = ray.wait(list(self._waiting), num_returns=1, fetch_local=False)
        more, _ = ray.wait(list(self._waiting), num_returns=len(self._waiting), timeout=0)
        for ref in dict.fromkeys((*ready, *more)):
            job = self._waiting.pop(ref)
            result, artifact = _outcome(ref, job)
            if artifact is not None:
                _keep(job.artifact, artifact)
            yield result

    def close(self) -> None:
        """Stop what is under way."""
        import ray

        for ref in self._waiting:
            ray.cancel(ref, force=True)
        self._waiting.clear()
        self._references.clear()

    def _reference(self, path: Path) -> Any:
        import ray

        if path not in self._references:
            self._references[path] = ray.put(path.read_bytes())
            while len(self._references) > REFERENCES_KEPT:
                self._references.popitem(last=False)
        return self._references[path]


def _outcome(ref: Any, job: Job) -> tuple[Result, bytes | None]:
    import ray
    from ray.exceptions import RayError, RaySystemError, RayTaskError

    try:
        return ray.get(ref)
    except (RayTaskError, RaySystemError) as error:  # not of the job, whose failures are results
        told = str(error).strip().splitlines()[-1]
        raise MissingDependency(
            f"a node of the cluster cannot work: {told}; set it up like this machine, with the "
            "same packages in the same folders"
        ) from error
    except RayError as error:
        reason = f"crash: its node was lost {NODES_PER_JOB + 1} times ({type(error).__name__})"
        return failed(job, reason), None


def _keep(path: Path, artifact: bytes) -> None:
    try:
        write_whole(path, artifact)
    except OSError as error:
        raise CannotWrite(
            f"{path}: cannot be written ({error.strerror}); make room and run again"
        ) from error


def _wants_gpu(job: Job) -> bool:
    if job.method == GROUND_TRUTH or job.device == "cpu":
        return False
    return find_method(job.method).weights_file is not None
