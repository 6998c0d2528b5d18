"""Looks at this machine from a process of its own, so that a driver that crashes takes only that.

`python -m bench.running.probe` prints one JSON object; `environment()` runs it and reads the
answer.
"""

from __future__ import annotations

import json
import subprocess
import sys
from importlib.metadata import version

from bench.running.isolation import WORKER_ENVIRONMENT
from data_prep.failures import MissingDependency

TIMEOUT_S = 120


def environment() -> dict[str, str]:
    """What the project's pictures depend on beside its own code.

    Raises MissingDependency where nothing can be rendered on this machine; the message says which
    Debian packages to install.
    """
    import os

    from data_prep.render import REMEDY

    try:
        done = subprocess.run(
            [sys.executable, "-m", "bench.running.probe"],
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
    from data_prep import render

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


if __name__ == "__main__":
    main()
