"""The ratios between speed and accuracy that are measured apart from a run: some 20 minutes.

    python -m studies.trade [--only pc2pix,metrics,rendering,harness]

Runs the studies named below one after another, each in a process of its own, and lets them print.
The share of the harness is printed by a run of the default suite itself. Leave the machine alone
meanwhile.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile

from studies.arguments import names

PARTS = {
    "pc2pix": [
        ["studies.inference_speed", "--threads", "2"],
        ["studies.inference_speed", "--threads", "1", "--chairs", "0"],
    ],
    "metrics": [["studies.metric_speed"], ["studies.metric_speed", "--threads", "2"]],
    "rendering": [["studies.render_speed"]],
    "harness": [["bench.cli", "run", "--suite", "chair-robustness"]],
}


def main() -> None:
    """Run the chosen parts; the exit status is 1 where one failed."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--only", type=names, default=tuple(PARTS), help="comma-separated")
    chosen = options.parse_args().only
    if unknown := set(chosen) - set(PARTS):
        options.error(f"--only: unknown {', '.join(sorted(unknown))}; there are {', '.join(PARTS)}")
    failed = []
    with tempfile.TemporaryDirectory() as scratch:
        for part in chosen:
            for command in PARTS[part]:
                if part == "harness":
                    command = [*command, "--out", f"{scratch}/run"]
                print(f"\n## {part}: {' '.join(command)} (load {os.getloadavg()[0]:.2f})\n")
                sys.stdout.flush()
                if subprocess.run([sys.executable, "-m", *command]).returncode:
                    failed.append(" ".join(command))
    for command in failed:
        print(f"FAILED {command}")
    sys.exit(bool(failed))


if __name__ == "__main__":
    main()
