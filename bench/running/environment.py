"""The manifest: everything about a run that its records do not say."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from collections.abc import Mapping
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from bench.catalogue.methods import objectives
from bench.records.record import SCHEMA_VERSION
from bench.running.protocol import Protocol, method_identity
from bench.running.shards import WHOLE

PACKAGES = (
    "pc2pix-bench",
    "torch",
    "pymeshlab",
    "pyrender",
    "PyOpenGL",
    "trimesh",
    "numpy",
    "scipy",
    "pandas",
    "pyarrow",
)


def describe(
    protocol: Protocol, workers: int, skipped_metrics: Mapping[str, str]
) -> dict[str, Any]:
    """The manifest of a run that is about to start."""
    return {
        "schema_version": SCHEMA_VERSION,
        "suite": protocol.suite.id,
        "dataset": protocol.dataset,
        "views": protocol.views,
        "seed": protocol.seed,
        "device": protocol.device,
        "shard": str(protocol.shard) if protocol.shard else WHOLE,
        "methods": list(protocol.methods),
        "identities": {m: method_identity(m, protocol.device) for m in protocol.methods},
        "objectives": objectives(protocol.methods),
        "conditions": list(protocol.conditions),
        "objects": [f"{o.class_name}/{o.object_id}" for o in protocol.objects],
        "skipped_metrics": dict(skipped_metrics),
        "feature_identity": dict(protocol.feature_identity),
        "environment": dict(protocol.environment),
        "workers": workers,
    } | circumstances()


def circumstances() -> dict[str, Any]:
    """Command, time, versions, machine and checkout: what is the same for all kinds of runs."""
    return {
        "command": sys.argv,
        "started": now(),
        "finished": None,
        "versions": versions(),
        "machine": {
            "platform": platform.platform(),
            "cpu": _cpu(),
            "cores": cores(),
            "memory_gib": round(
                os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30, 1
            ),
        },
        "git": _git(),
    }


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0))


def now() -> str:
    """The time, UTC, to the second."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def versions() -> dict[str, str]:
    """Of Python and the packages that results may depend on."""
    found = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not installed"
    return found


def _cpu() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return models[0] if models else platform.processor()


def _git() -> dict[str, Any]:
    """Commit and cleanliness of the checkout; empty where this is none."""
    root = Path(__file__).resolve().parents[2]
    try:
        commit, status = (
            subprocess.run(
                ["git", "-C", str(root), *command],
                capture_output=True,
                text=True,
                check=True,
                timeout=10,
            ).stdout.strip()
            for command in (["rev-parse", "HEAD"], ["status", "--porcelain"])
        )
    except (OSError, subprocess.SubprocessError):
        return {}
    return {"commit": commit, "clean": not status}
