"""The work of a node of a cluster, and the requirements that it has to meet."""

from __future__ import annotations

import json
import os
import socket
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

from bench.catalogue.methods import find_run_method
from bench.catalogue.suites import Limits
from bench.records.job import Job, Result, failed
from bench.running.environment import CODE, code_sha256, environment, versions
from bench.running.executors import JobPool
from bench.running.protocol import Protocol, method_identity
from data_prep.datasets.objects import SceneObject
from data_prep.failures import BadInput, MissingDependency
from data_prep.files.checksums import file_sha256


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
        Identities of the methods by their addresses, see `bench.running.protocol.method_identity`.
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
        while not (results := [*self._pool.wait_any()]):
            pass  # a job may take several steps
        return results[0]


_node: Node | None = None  # of this process, where it is one of Ray's


def do_on_node(
    message: tuple[NodeRequirements, Limits], job: Job, fingerprint: str, reference: bytes | None
) -> Result:
    """Do a job on the node that this process is; Ray calls this for each task.

    `fingerprint` is that of its object. `reference` are the true images, which Ray sends once for
    the jobs of an object.
    """
    global _node
    if _node is None:
        _node = Node(*message)
    return _node.run_job(replace(job, reference=reference), fingerprint)


def requirements(protocol: Protocol) -> NodeRequirements:
    """Return the properties of this machine, which all nodes have to share."""
    return NodeRequirements(
        environment=protocol.environment,
        versions=versions(),
        code=_code(),
        identities=_identities(
            (method.address for method in protocol.methods.values()), protocol.device
        ),
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
    return {package: code_sha256([package])[:16] for package in CODE}


def _identities(addresses: Iterable[str], device: str) -> dict[str, str]:
    identities = {}
    for address in addresses:
        try:
            identities[address] = json.dumps(method_identity(find_run_method(address), device))
        except BadInput as error:  # its weights are not here
            identities[address] = str(error)
    return identities


def _sum(path: str) -> str:
    try:
        return file_sha256(Path(path))
    except (BadInput, OSError) as error:
        return str(error).removeprefix(f"{path}: ")
