"""What a node of a Ray cluster does: one job at a time, in a killable process of its own.

The node is told what it has to have in common with the machine that keeps the run (`Demands`), and
proves it before its first job: pictures of another driver or another version of a file would go
into the same tables unseen. It need not share a file system. The true pictures that a job is scored
against come with the job, its artifact goes back as bytes (about 0.1 MB for 20 views).
"""

from __future__ import annotations

import json
import os
import socket
import tempfile
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

from bench.isolation import Limits
from bench.manifest import versions
from bench.plan import Protocol, method_identity
from bench.pool import JobPool
from bench.probe import environment
from bench.sources import code_sha256
from bench.work import Job, Result, failed
from data_prep.failures import BadInput, MissingDependency
from data_prep.fingerprints import file_sha256
from data_prep.scene_objects import SceneObject

PACKAGES = ("data_prep", "learning", "baselines", "pc2pix", "bench")


@dataclass(frozen=True)
class Demands:
    """What all nodes have in common.

    environment  what `bench.probe` finds
    versions     of packages
    code         checksum of this project's own
    identities   of the methods, see `bench.plan.method_identity`
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

    def __init__(self, demands: Demands, limits: Limits) -> None:
        with suppress(OSError):  # not there: a path that needs it will say so
            os.chdir(demands.folder)
        self._unfit = unfit(demands)
        self._pool = JobPool(1, 1, limits)

    def do(
        self, job: Job, fingerprint: str, reference: bytes | None
    ) -> tuple[Result, bytes | None]:
        """The result of a job, and its artifact where there is one.

        `fingerprint` is that of its object where the run is kept, `reference` the artifact that it
        is scored against. A node that is not fit, or whose copy of the object is another, gives a
        result that is `unusable` and says why.
        """
        if unfit := self._unfit or _other_object(job.object, fingerprint):
            unfit = f"node {socket.gethostname()}: {unfit}"
            return replace(failed(job, unfit), unusable=unfit), None
        with tempfile.TemporaryDirectory(prefix="pc2pix-bench-") as scratch:
            artifact, scored = Path(scratch, "artifact.npz"), None
            if reference is not None:
                scored = Path(scratch, "reference.npz")
                scored.write_bytes(reference)
            self._pool.submit(replace(job, artifact=artifact, reference=scored))
            (result,) = self._pool.collect()
            return result, artifact.read_bytes() if result.artifact_sha256 else None


_node: Node | None = None  # of this process, where it is one of Ray's


def do_on_node(
    told: tuple[Demands, Limits], job: Job, fingerprint: str, reference: bytes | None
) -> tuple[Result, bytes | None]:
    """`Node.do` of the node that this process is; Ray has it do one job after another."""
    global _node
    if _node is None:
        _node = Node(*told)
    return _node.do(job, fingerprint, reference)


def demands(protocol: Protocol) -> Demands:
    """What this machine has, to be asked of others."""
    return Demands(
        environment=protocol.environment,
        versions=versions(),
        code=_code(),
        identities=_identities(protocol.methods, protocol.device),
        weights={path: _sum(path) for _, path in protocol.features},
        device=protocol.device,
        folder=str(Path.cwd()),
    )


def unfit(demands: Demands) -> str:
    """In what this machine does not meet the demands, and the remedy; empty where it does."""
    try:
        found = environment()
    except MissingDependency as error:
        return str(error)
    for what, here, wanted in (
        ("environment", found, demands.environment),
        ("versions", versions(), demands.versions),
        ("code", _code(), demands.code),
        ("methods", _identities(demands.identities, demands.device), demands.identities),
        ("weights", {path: _sum(path) for path in demands.weights}, demands.weights),
    ):
        if differing := [name for name in wanted if here.get(name) != wanted[name]]:
            told = ", ".join(f"{n} is {here.get(n)}, not {wanted[n]}" for n in differing)
            return f"not set up as the machine of the run, {what}: {told}; make it the same"
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
