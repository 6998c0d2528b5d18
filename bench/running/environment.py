"""The machine, the libraries and the code that a run depends on.

`python -m bench.running.environment` looks at the graphics driver from a process of its own, so
that a driver that crashes takes only that, and prints one JSON object; `environment()` runs it and
reads the answer.
"""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
from collections.abc import Iterable
from datetime import UTC, datetime
from hashlib import sha256
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from bench.running.isolation import WORKER_ENVIRONMENT
from bench.running.worker_process import own_python
from data_prep.failures import MissingDependency

ROOT = Path(__file__).resolve().parents[2]
SUFFIXES = (".py", ".vert", ".frag")  # of code
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
VECTOR = ("sse4", "avx", "fma", "amx", "asimd", "sve")  # begin the names of such instructions


def machine_info() -> dict[str, Any]:
    """Command, time, versions, machine and checkout: what is the same for all kinds of runs."""
    return {
        "command": sys.argv,
        "started": now(),
        "finished": None,
        "versions": versions(),
        "machine": {
            "platform": platform.platform(),
            "cpu": _cpu(),
            "instructions": _instructions(),
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
    return _of_processor("model name") or platform.processor()


def _instructions() -> str:
    """What libraries choose their code by, so that they round differently: a name like "AMD EPYC"
    stands for many processors."""
    vector = [
        name
        for name in (_of_processor("flags") or _of_processor("Features")).split()
        if name.startswith(VECTOR)
    ]
    which = f"family {_of_processor('cpu family')}, model {_of_processor('model')}"
    return f"{which}: {' '.join(vector)}"


def _of_processor(name: str) -> str:
    """What Linux says about the first processor; empty where it says nothing."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return ""
    fields = (line.partition(":") for line in lines)
    return next((value.strip() for key, _, value in fields if key.strip() == name), "")


def _git() -> dict[str, Any]:
    """Commit and cleanliness of the checkout; empty where this is none: installed, the packages may
    lie in a checkout of something else."""
    try:
        root, commit, status = (
            subprocess.run(
                ["git", "-C", str(ROOT), *command],
                capture_output=True,
                text=True,
                check=True,
                timeout=10,
            ).stdout.strip()
            for command in (
                ["rev-parse", "--show-toplevel"],
                ["rev-parse", "HEAD"],
                ["status", "--porcelain"],
            )
        )
    except (OSError, subprocess.SubprocessError):
        return {}
    return {"commit": commit, "clean": not status} if Path(root) == ROOT else {}


TIMEOUT_S = 120


def environment() -> dict[str, str]:
    """What the project's images depend on beside its own code.

    Raises MissingDependency where nothing can be rendered on this machine; the message says which
    Debian packages to install.
    """
    from data_prep.rendering.opengl import REMEDY

    try:
        done = subprocess.run(
            own_python("-m", "bench.running.environment"),
            env=os.environ | WORKER_ENVIRONMENT,
            capture_output=True,
            text=True,
            timeout=TIMEOUT_S,
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        raise MissingDependency(f"OpenGL did not answer in {TIMEOUT_S} s: {REMEDY}") from error
    lines = done.stdout.strip().splitlines()
    try:
        answer = json.loads(lines[-1])
    except (IndexError, ValueError) as error:
        raise MissingDependency(
            f"OpenGL ended its process (exit code {done.returncode}): {REMEDY}"
        ) from error
    if "error" in answer:
        raise MissingDependency(answer["error"])
    return answer


def main() -> None:
    """Print the environment, or the reason why there is none."""
    from data_prep.rendering import opengl as render

    try:
        answer = {
            "gl": render.gl_renderer(),
            "render": str(render.VERSION),
            "pyrender": version("pyrender"),
            "numpy": version("numpy"),
        }
    except MissingDependency as error:
        answer = {"error": str(error)}
    print(json.dumps(answer))


def code_sha256(names: Iterable[str], root: Path = ROOT) -> str:
    """Of all code in those folders and files below `root`, names included."""
    files = [
        path
        for name in names
        for path in ((root / name).rglob("*") if (root / name).is_dir() else [root / name])
        if path.suffix in SUFFIXES
    ]
    lines = (
        f"{path.relative_to(root)} {sha256(path.read_bytes()).hexdigest()}"
        for path in sorted(files)
    )
    return sha256("\n".join(lines).encode()).hexdigest()


if __name__ == "__main__":
    main()
