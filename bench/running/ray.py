"""Jobs on a Ray cluster: an executor whose workers are Ray's, and what a node does.

Ray decides where a job is done, and does those of a lost node again elsewhere; nothing else is left
to it. A job that fails, hangs or takes its process down is a result like on one machine, and is not
tried again. Jobs and results are plain values of some kB; of a run's files none has to be reachable
from the nodes, and nothing but this process writes into its folder.

A node does one job at a time, in a killable process of its own. It gets a list of what it has to
have in common with the machine that keeps the run (`NodeRequirements`), and proves it before its
first job: images of another driver or another version of a file would go into the same tables
unseen. The true images that a job is scored against come with the job, its artifact goes back as
bytes (about 0.1 MB for 20 views).
"""

from __future__ import annotations

import json
import logging
import os
import socket
import tempfile
import time
from collections import OrderedDict
from collections.abc import Iterable, Iterator, Mapping
from contextlib import chdir, contextmanager, suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from bench.catalogue.methods import find_method
from bench.catalogue.suites import Limits
from bench.records.artifacts import write_artifact
from bench.records.job import Job, Result, failed
from bench.records.record import GROUND_TRUTH
from bench.running.environment import code_sha256, environment, versions
from bench.running.executors import JobPool
from bench.running.protocol import LOCAL, Protocol, method_identity
from data_prep.datasets.objects import SceneObject
from data_prep.failures import BadInput, MissingDependency
from data_prep.files.checksums import file_sha256

PACKAGES = ("data_prep", "learning", "baselines", "pc2pix", "bench")


@dataclass(frozen=True)
class NodeRequirements:
    """What all nodes have in common.

    environment  what `bench.running.environment` finds
    versions     of packages
    code         checksum of this project's own
    identities   of the methods, see `bench.running.protocol.method_identity`
    weights      checksums of the files that extractors load
    device       where networks run
    folder       relative paths start here, where there is such a folder
    """

    environment: Mapping[str, str]
    versions: Mapping[str, str]
    code: Mapping[str, str]
    identities: Mapping[str, str]
    weights: Mapping[str, str]
    device: str
    folder: str


class Node:
    """A process of Ray's, with the process that does its jobs."""

    def __init__(self, requirements: NodeRequirements, limits: Limits) -> None:
        with suppress(OSError):  # not there: a path that needs it will say so
            os.chdir(requirements.folder)
        self._mismatch = mismatch(requirements)
        self._pool = JobPool(1, 1, limits)

    def run_job(
        self, job: Job, fingerprint: str, reference: bytes | None
    ) -> tuple[Result, bytes | None]:
        """The result of a job, and its artifact where there is one.

        `fingerprint` is that of its object where the run is kept, `reference` the artifact that it
        is scored against. A node that is not fit, or whose copy of the object is another, gives a
        result that is `unusable` and says why.
        """
        if mismatch := self._mismatch or _other_object(job.object, fingerprint):
            mismatch = f"node {socket.gethostname()}: {mismatch}"
            return replace(failed(job, mismatch), unusable=mismatch), None
        with tempfile.TemporaryDirectory(prefix="pc2pix-bench-") as scratch:
            artifact, scored = Path(scratch, "artifact.npz"), None
            if reference is not None:
                scored = Path(scratch, "reference.npz")
                scored.write_bytes(reference)
            self._pool.submit(replace(job, artifact=artifact, reference=scored))
            (result,) = self._pool.wait_any()
            return result, artifact.read_bytes() if result.artifact_sha256 else None


_node: Node | None = None  # of this process, where it is one of Ray's


def do_on_node(
    message: tuple[NodeRequirements, Limits], job: Job, fingerprint: str, reference: bytes | None
) -> tuple[Result, bytes | None]:
    """`Node.run_job` of the node that this process is; Ray has it do one job after another."""
    global _node
    if _node is None:
        _node = Node(*message)
    return _node.run_job(job, fingerprint, reference)


def requirements(protocol: Protocol) -> NodeRequirements:
    """What this machine has, to be asked of others."""
    return NodeRequirements(
        environment=protocol.environment,
        versions=versions(),
        code=_code(),
        identities=_identities(protocol.methods, protocol.device),
        weights={path: _sum(path) for _, path in protocol.features},
        device=protocol.device,
        folder=str(Path.cwd()),
    )


def mismatch(requirements: NodeRequirements) -> str:
    """In what this machine does not meet the requirements, and the remedy; empty where it does."""
    try:
        found = environment()
    except MissingDependency as error:
        return str(error)
    for what, here, wanted in (
        ("environment", found, requirements.environment),
        ("versions", versions(), requirements.versions),
        ("code", _code(), requirements.code),
        (
            "methods",
            _identities(requirements.identities, requirements.device),
            requirements.identities,
        ),
        ("weights", {path: _sum(path) for path in requirements.weights}, requirements.weights),
    ):
        if differing := [name for name in wanted if here.get(name) != wanted[name]]:
            message = ", ".join(f"{n} is {here.get(n)}, not {wanted[n]}" for n in differing)
            return f"not set up as the machine of the run, {what}: {message}; make it the same"
    return ""


def _other_object(obj: SceneObject, fingerprint: str) -> str:
    found = fingerprint_of(obj)
    if found == fingerprint:
        return ""
    return (
        f"{obj.class_name}/{obj.object_id} is not what it is in the run ({found[:40]}, not "
        f"{fingerprint[:40]}); put the same dataset into the same folder on all nodes"
    )


@lru_cache(maxsize=64)
def fingerprint_of(obj: SceneObject) -> str:
    """Read once for the jobs of an object, which follow each other."""
    return obj.fingerprint()


def _code() -> dict[str, str]:
    """A checksum for each package of this project."""
    return {package: code_sha256([package])[:16] for package in PACKAGES}


def _identities(methods: Iterable[str], device: str) -> dict[str, str]:
    found = {}
    for method in methods:
        try:
            found[method] = json.dumps(method_identity(method, device))
        except BadInput as error:  # its weights are not here
            found[method] = str(error)
    return found


def _sum(path: str) -> str:
    try:
        return file_sha256(Path(path))
    except (BadInput, OSError) as error:
        return str(error).removeprefix(f"{path}: ")


PATIENCE_S = 10.0
COUNTED_EVERY_S = 5.0  # the CPUs of a cluster
NODES_PER_JOB = 5  # lost ones; then it is the job that takes them down
REFERENCES_KEPT = 64  # true images in the object store; jobs of one object follow each other
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
    _check_reachable(address)
    own = {"num_cpus": workers, "object_store_memory": STORE_BYTES, "include_dashboard": False}
    try:
        with chdir("/"):  # workers would import from the current folder: a `random.py`, say
            ray.init(
                address=address,
                logging_level=logging.ERROR,
                log_to_driver=False,
                **(own if address == LOCAL else {}),
            )
    except (ConnectionError, RuntimeError, ValueError, OSError) as error:
        message = (str(error).strip().splitlines() or [type(error).__name__])[0]
        raise _no_cluster(address, message) from error
    try:
        there = ray.cluster_resources()
        nodes = sum(node["Alive"] for node in ray.nodes())
        yield Cluster(
            address, int(there.get("CPU", 0)), int(there.get("GPU", 0)), nodes, ray.__version__
        )
    finally:
        ray.shutdown()


def _check_reachable(address: str) -> None:
    """Raises BadInput where nobody listens at "host:port": Ray would ask for minutes."""
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
    """Does jobs on the nodes of a cluster, an executor. To be made within `connected`.

    A CPU each; a GPU as well for a network, where the cluster has any and the device is not "cpu".
    """

    def __init__(self, cluster: Cluster, limits: Limits, requirements: NodeRequirements) -> None:
        import ray

        self._gpus = cluster.gpus
        self._room, self._counted = 0, float("-inf")
        self._text = ray.put((requirements, limits))
        remote = ray.remote(num_cpus=1, max_retries=NODES_PER_JOB, max_calls=0)  # 0: no end
        self._do = remote(do_on_node)
        self._waiting: dict[Any, Job] = {}
        self._references: OrderedDict[Path, Any] = OrderedDict()

    @property
    def capacity(self) -> int:
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
            self._text, job, fingerprint_of(job.object), reference
        )
        self._waiting[ref] = job

    def wait_any(self) -> Iterator[Result]:
        """Wait until jobs have ended; the result of each, its artifact written."""
        import ray

        ready, _ = ray.wait(list(self._waiting), num_returns=1, fetch_local=False)
        more, _ = ray.wait(list(self._waiting), num_returns=len(self._waiting), timeout=0)
        for ref in dict.fromkeys((*ready, *more)):
            job = self._waiting.pop(ref)
            result, artifact = _outcome(ref, job)
            if artifact is not None:
                write_artifact(job.artifact, artifact)
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
        message = str(error).strip().splitlines()[-1]
        raise MissingDependency(
            f"a node of the cluster cannot work: {message}; set it up like this machine, with the "
            "same packages in the same folders"
        ) from error
    except RayError as error:
        reason = f"crash: its node was lost {NODES_PER_JOB + 1} times ({type(error).__name__})"
        return failed(job, reason), None


def _wants_gpu(job: Job) -> bool:
    if job.method == GROUND_TRUTH or job.device == "cpu":
        return False
    return find_method(job.method).weights_file is not None
