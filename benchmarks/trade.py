"""Every ratio of the trade between speed and accuracy, in one run: some 20 minutes.

    python -m benchmarks.trade [--only pc2pix,surface-fit,metrics,rendering,harness]
                               [--dataset folder:PATH]

Calls the benchmarks named below one after another, each in a process of its own, and lets them
print. `--dataset` adds real chairs to the comparison of the surfaces. The share of the harness is
printed by a run of the default suite itself. Leave the machine alone meanwhile.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

MODULE = [sys.executable, "-m"]
PARTS = {
    "pc2pix": [
        ["benchmarks.inference_speed", "--threads", "2"],
        ["benchmarks.inference_speed", "--threads", "1", "--chairs", "0"],
    ],
    "surface-fit": [["benchmarks.surface_fit"]],
    "metrics": [["benchmarks.metric_speed"], ["benchmarks.metric_speed", "--threads", "2"]],
    "rendering": [["benchmarks.render_speed"]],
    "harness": [["bench.cli", "run", "--suite", "chair-robustness"]],
}


def main() -> None:
    """Run what is asked for; the exit status is 1 where a part failed."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--only", default=",".join(PARTS), help="comma-separated")
    options.add_argument("--dataset", help="further chairs for surface-fit")
    given = options.parse_args()
    chosen = given.only.split(",")
    if unknown := set(chosen) - set(PARTS):
        options.error(f"--only: unknown {', '.join(sorted(unknown))}; there are {', '.join(PARTS)}")
    failed = []
    with tempfile.TemporaryDirectory() as scratch:
        for part in chosen:
            for command in commands(part, given.dataset, Path(scratch)):
                loads = os.getloadavg()[0]
                print(f"\n## {part}: {' '.join(command)} (load {loads:.2f})\n", flush=True)
                if subprocess.run(MODULE + command).returncode:
                    failed.append(" ".join(command))
    for command in failed:
        print(f"FAILED {command}")
    sys.exit(bool(failed))


def commands(part: str, dataset: str | None, scratch: Path) -> list[list[str]]:
    """What a part consists of."""
    found = PARTS[part]
    if part == "surface-fit" and dataset:
        found = [*found, [*found[0], "--dataset", dataset]]
    if part == "harness":
        found = [[*command, "--out", str(scratch / "run")] for command in found]
    return found


if __name__ == "__main__":
    main()
