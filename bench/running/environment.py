"""The machine, the libraries and the code that a run depends on.

`environment` runs `python -m bench.running.environment`, which asks the graphics driver and prints
one JSON object: a driver that crashes ends that process only.
"""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
from collections.abc import Callable, Iterable, Mapping
from datetime import UTC, datetime
from hashlib import sha256
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from bench.running.pool import WORKER_ENVIRONMENT
from bench.running.worker import own_python
from data_prep.failures import MissingDependency

ROOT = Path(__file__).resolve().parents[2]
CODE = ("data_prep", "learning", "baselines", "pc2pix", "bench")  # all packages of the project
SUFFIXES = (".py", ".vert", ".frag")  # of code
PACKAGES = (
    *("pc2pix-bench", "torch", "pymeshlab", "pyrender", "PyOpenGL", "embreex", "trimesh"),
    *("numpy", "scipy", "pandas", "pyarrow"),
)
# By which values may differ in their last digits.
_LIBRARIES = ("torch", "pymeshlab", "pyrender", "PyOpenGL", "trimesh", "numpy", "scipy")
ENVIRONMENTS = "environments"  # in a manifest: those of its jobs
MIXED = " | "  # between the values of several
_TIMEOUT_S = 120
_VECTOR = ("sse4", "avx", "fma", "amx", "asimd", "sve")  # begin the names of such instructions


def command_line() -> list[str]:
    """Return the command of this process; bytes that are not UTF-8 become escapes."""
    # A manifest is UTF-8, and a folder may have any name.
    return [word.encode(errors="backslashreplace").decode() for word in sys.argv]


def machine_info() -> dict[str, Any]:
    """Return the entries of a manifest on command, time, versions and machine."""
    cpu = _first_processor()
    flags = (cpu.get("flags") or cpu.get("Features") or "").split()
    vector = " ".join(name for name in flags if name.startswith(_VECTOR))
    memory_b = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return {
        "command": command_line(),
        "started": now(),
        "finished": None,
        "versions": versions(),
        "machine": {
            "platform": platform.platform(),
            "cpu": cpu.get("model name") or platform.processor(),
            # By these libraries choose their code, and round differently; a name like "AMD EPYC"
            # stands for many processors.
            "instructions": f"family {cpu.get('cpu family', '')}, "
            f"model {cpu.get('model', '')}: {vector}",
            "cores": cores(),
            "memory_gib": round(memory_b / 2**30, 1),
        },
        "git": _git(),
    }


def started_environment(manifest: Mapping[str, Any]) -> dict[str, str]:
    """Return everything that images depend on beside the project's own code and weights.

    It is that of the start of a run. Where two jobs have the same, their values are the same to the
    last digit.
    """
    machine, made_with = manifest.get("machine") or {}, manifest.get("versions", {})
    return {
        "gl": str(manifest.get("environment", {}).get("gl")),
        "cpu": f"{machine.get('cpu')}, {machine.get('instructions', 'unknown')}",
        # The processors of a cluster's nodes are not in the manifest.
        "cluster": "yes" if manifest.get("cluster") else "no",
        "device": str(manifest["device"]),
        **{name: str(made_with.get(name)) for name in _LIBRARIES},
    }


def environments_entry(environments: Iterable[tuple[Mapping[str, str], int]]) -> list[Any]:
    """Return environments with their numbers of jobs as the manifest of a run has them."""
    return [{"jobs": jobs, **environment} for environment, jobs in environments]


def environment_of(manifest: Mapping[str, Any]) -> dict[str, str]:
    """Return what all jobs of a run were made with, values that differ with MIXED between them."""
    every = manifest.get(ENVIRONMENTS) or [started_environment(manifest)]
    names = dict.fromkeys(name for facts in every for name in facts if name != "jobs")
    return {name: MIXED.join(dict.fromkeys(str(e.get(name)) for e in every)) for name in names}


def is_same(here: Mapping[str, str], other: Mapping[str, str]) -> bool:
    """Return whether two runs have one environment, each of them and both together."""
    return here == other and not any(MIXED in value for value in here.values())


def environment_changes(was: Mapping[str, str], here: Mapping[str, str]) -> str:
    """Return what differs between two environments in words; "" where nothing does."""
    names = [name for name in dict.fromkeys((*was, *here)) if was.get(name) != here.get(name)]
    return ", ".join(f"{name} {was.get(name)} -> {here.get(name)}" for name in names)


def told_mixture(manifest: Mapping[str, Any]) -> str:
    """Return how many jobs of a run were made with what; "" where all were made with the same."""
    every = manifest.get(ENVIRONMENTS, ())
    if len(every) < 2:
        return ""
    names = [name for name, value in environment_of(manifest).items() if MIXED in value]
    parts = [f"{e['jobs']} with {', '.join(f'{n} {e.get(n)}' for n in names)}" for e in every]
    return f"its jobs were made in {len(every)} environments: {'; '.join(parts)}"


def _first_processor() -> dict[str, str]:
    """Return the entries of Linux on the first processor."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        return {}
    fields = (line.partition(":") for line in reversed(text.splitlines()))
    return {key.strip(): value.strip() for key, _, value in fields}


def cores() -> int:
    """Return the number of cores that this process may use."""
    if not hasattr(os, "sched_getaffinity"):  # macOS
        return os.cpu_count() or 1
    return len(os.sched_getaffinity(0))


def now() -> str:
    """Return the time, UTC, to the second."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def versions() -> dict[str, str]:
    """Return the versions of Python and of the packages that results may depend on."""
    installed = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            installed[package] = version(package)
        except PackageNotFoundError:
            installed[package] = "not installed"
    return installed


def _git() -> dict[str, Any]:
    """Return commit and cleanliness of the checkout; installed packages may lie in another's."""

    def ask(*command: str) -> str:
        line = ["git", "-C", str(ROOT), *command]
        done = subprocess.run(line, capture_output=True, text=True, check=True, timeout=10)
        return done.stdout.strip()

    try:
        if Path(ask("rev-parse", "--show-toplevel")) != ROOT:
            return {}
        return {"commit": ask("rev-parse", "HEAD"), "clean": not ask("status", "--porcelain")}
    except (OSError, subprocess.SubprocessError):
        return {}


def environment(
    execute: Callable[..., subprocess.CompletedProcess[str]] = subprocess.run,
) -> dict[str, str]:
    """Return the libraries and the driver that images depend on, and the constants of the scene.

    `execute` stands in for `subprocess.run`. Raises MissingDependency where nothing can be
    rendered on this machine, with the Debian packages to install.
    """
    from data_prep.rendering.opengl import REMEDY, scene_values

    try:
        done = execute(
            own_python("-m", "bench.running.environment"),
            env=os.environ | WORKER_ENVIRONMENT,
            capture_output=True,
            text=True,
            timeout=_TIMEOUT_S,
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        raise MissingDependency(f"OpenGL did not answer in {_TIMEOUT_S} s: {REMEDY}") from error
    lines = done.stdout.strip().splitlines()
    try:
        answer = json.loads(lines[-1])
    except (IndexError, ValueError) as error:
        raise MissingDependency(
            f"OpenGL ended its process (exit code {done.returncode}): {REMEDY}"
        ) from error
    if "error" in answer:
        raise MissingDependency(answer["error"])
    return answer | scene_values()


def main(find_renderer: Callable[[], str] | None = None) -> None:
    """Print the environment, or the reason why nothing can be rendered."""
    from data_prep.rendering import opengl

    try:
        answer = {
            "gl": (find_renderer or opengl.gl_renderer)(),
            "render": str(opengl.VERSION),
            "pyrender": version("pyrender"),
            "numpy": version("numpy"),
        }
    except MissingDependency as error:
        answer = {"error": str(error)}
    print(json.dumps(answer))


def code_sha256(names: Iterable[str], root: Path = ROOT) -> str:
    """Return a checksum of all code, names included, in these folders and files below `root`."""
    files = sorted(
        path
        for name in names
        for path in (root / name, *(root / name).rglob("*"))
        if path.suffix in SUFFIXES
    )
    lines = (f"{f.relative_to(root)} {sha256(f.read_bytes()).hexdigest()}" for f in files)
    return sha256("\n".join(lines).encode()).hexdigest()


if __name__ == "__main__":
    main()
