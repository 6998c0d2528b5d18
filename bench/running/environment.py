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

ROOT = Path(__file__).resolve().parents[2]  # the folder of the project's packages
CODE = ("data_prep", "learning", "baselines", "pc2pix", "bench")  # all packages of the project
SUFFIXES = (".py", ".vert", ".frag")  # the ends of the names of files of code
# The distributions whose versions a manifest has.
PACKAGES = (
    "pc2pix-bench",
    "torch",
    "pymeshlab",
    "pyrender",
    "PyOpenGL",
    "embreex",
    "trimesh",
    "numpy",
    "scipy",
    "pandas",
    "pyarrow",
)
# The libraries with whose versions values may differ in their last digits.
_LIBRARIES = ("torch", "pymeshlab", "pyrender", "PyOpenGL", "trimesh", "numpy", "scipy")
ENVIRONMENTS = "environments"  # the entry of a manifest with the environments of its jobs
MIXED = " | "  # stands between the values of one fact in several environments
_TIMEOUT_S = 120  # seconds that the graphics driver may take to answer
# The beginnings of the names of vector instructions, as Linux has them among a processor's flags.
_VECTOR = ("sse4", "avx", "fma", "amx", "asimd", "sve")


def command_line() -> list[str]:
    """Return the command line of this process, with escapes for bytes that are not UTF-8.

    A manifest is UTF-8, but a folder that the command names may have any bytes in its name.
    """
    return [word.encode(errors="backslashreplace").decode() for word in sys.argv]


def machine_info() -> dict[str, Any]:
    """Return the entries of a manifest about the command, the time, versions and the machine."""
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
            # Libraries choose their code by the instructions that a processor has, and so round
            # differently. Its name is not enough: one like "AMD EPYC" stands for many processors.
            "instructions": f"family {cpu.get('cpu family', '')}, "
            f"model {cpu.get('model', '')}: {vector}",
            "cores": cores(),
            "memory_gib": round(memory_b / 2**30, 1),
        },
        "git": _git(),
    }


def started_environment(manifest: Mapping[str, Any]) -> dict[str, str]:
    """Return the environment in which a run was started, as its manifest has it.

    It is everything that images depend on beside the project's own code and weights: where two jobs
    have the same environment, their values are the same to the last digit.
    """
    machine, made_with = manifest.get("machine") or {}, manifest.get("versions", {})
    return {
        "gl": str(manifest.get("environment", {}).get("gl")),
        "cpu": f"{machine.get('cpu')}, {machine.get('instructions', 'unknown')}",
        # Of a cluster the manifest does not have the processors, so that it is a fact by itself.
        "cluster": "yes" if manifest.get("cluster") else "no",
        "device": str(manifest["device"]),
        **{name: str(made_with.get(name)) for name in _LIBRARIES},
    }


def environments_entry(environments: Iterable[tuple[Mapping[str, str], int]]) -> list[Any]:
    """Return the entry of a manifest for environments, each with its number of jobs."""
    return [{"jobs": jobs, **environment} for environment, jobs in environments]


def environment_of(manifest: Mapping[str, Any]) -> dict[str, str]:
    """Return the environment of all jobs of a run.

    Where jobs were made in several environments, a fact that differs has all its values, with MIXED
    between them.
    """
    environments = manifest.get(ENVIRONMENTS) or [started_environment(manifest)]
    values: dict[str, dict[str, None]] = {}  # the different values of each fact, in their order
    for environment in environments:
        for name in environment:
            if name != "jobs":
                values.setdefault(name, {})
    for name, different in values.items():
        for environment in environments:
            different[str(environment.get(name))] = None
    return {name: MIXED.join(different) for name, different in values.items()}


def is_same(here: Mapping[str, str], other: Mapping[str, str]) -> bool:
    """Return whether all jobs of two runs were made in the same environment."""
    return here == other and not any(MIXED in value for value in here.values())


def environment_changes(was: Mapping[str, str], here: Mapping[str, str]) -> str:
    """Return the differences between two environments, as in "numpy 2.1.0 -> 2.2.0".

    It is "" where there is none.
    """
    names = [name for name in dict.fromkeys((*was, *here)) if was.get(name) != here.get(name)]
    return ", ".join(f"{name} {was.get(name)} -> {here.get(name)}" for name in names)


def told_mixture(manifest: Mapping[str, Any]) -> str:
    """Return a text that tells how many jobs of a run were made in which environments.

    It names the facts that differ, and is "" where all jobs were made in the same environment.
    """
    environments = manifest.get(ENVIRONMENTS, ())
    if len(environments) < 2:
        return ""
    differing = [name for name, value in environment_of(manifest).items() if MIXED in value]
    parts = []
    for environment in environments:
        facts = ", ".join(f"{name} {environment.get(name)}" for name in differing)
        parts.append(f"{environment['jobs']} with {facts}")
    return f"its jobs were made in {len(environments)} environments: {'; '.join(parts)}"


def _first_processor() -> dict[str, str]:
    """Return what /proc/cpuinfo of Linux says about the first processor; {} on other systems."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        return {}
    # The entries of all processors have the same names. In reverse order the first ones count.
    fields = (line.partition(":") for line in reversed(text.splitlines()))
    return {key.strip(): value.strip() for key, _, value in fields}


def cores() -> int:
    """Return the number of cores that this process may use."""
    if not hasattr(os, "sched_getaffinity"):  # as on macOS
        return os.cpu_count() or 1
    return len(os.sched_getaffinity(0))


def now() -> str:
    """Return the current time in UTC, to the second, in the form of ISO 8601."""
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
    """Return the commit of the checkout, and whether its files are as committed.

    {} where this code is in no checkout of its own, as an installed package that may lie within the
    checkout of another project.
    """

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

    Raises MissingDependency where nothing can be rendered on this machine, with the Debian packages
    to install. Tests pass their own `execute` in place of `subprocess.run`.
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
    """Print the environment as JSON, or the reason why nothing can be rendered."""
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
    """Return a checksum of the names and contents of all files of code.

    names  the folders and files below `root` that are searched
    """
    files: list[Path] = []
    for name in names:
        paths = (root / name, *(root / name).rglob("*"))
        files += [path for path in paths if path.suffix in SUFFIXES]
    lines = []
    for path in sorted(files):
        lines.append(f"{path.relative_to(root)} {sha256(path.read_bytes()).hexdigest()}")
    return sha256("\n".join(lines).encode()).hexdigest()


if __name__ == "__main__":
    main()
