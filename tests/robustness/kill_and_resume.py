"""Runs killed with SIGKILL at random instants and resumed: the same tables, nothing twice or lost.

    python -m tests.robustness.kill_and_resume --runs 50

One run is left alone; its tables are the measure, its duration the span of the instants. Each other
run is killed, with all its workers, as often as `--kills` says, started again after each, and left
to its end; with `--budget` the starts that are killed have it, and the last has none. Then its
tables have to be the same bytes, its journal has to hold each key once, and all of them. Prints a
line a run and a summary; exit status 1 if one of them differs.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

PROTOCOL = (
    *("--suite", "chair-robustness", "--limit", "2", "--views", "2", "--workers", "2"),
    *("--methods", "surface-apss,pc2pix,splat,blank", "--conditions", "2048,noise-0.10"),
)


def command(out: Path, more: Sequence[str] = ()) -> list[str]:
    """The command line of a run."""
    main = "from bench.cli import main; main()"
    return [sys.executable, "-c", main, "run", *PROTOCOL, *more, "--out", str(out)]


def run_to_the_end(out: Path) -> float:
    """Run, or go on; the seconds it took."""
    start = time.perf_counter()
    subprocess.run(command(out), check=True, capture_output=True)
    return time.perf_counter() - start


def run_and_kill(out: Path, after_s: float, more: Sequence[str] = ()) -> bool:
    """Run with `more` options, and kill the whole process group after `after_s`; False if it had
    ended by then."""
    with subprocess.Popen(
        command(out, more),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    ) as process:
        try:
            process.wait(timeout=after_s)
            return False
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            return True


def tables(out: Path) -> dict[str, bytes]:
    """The bytes of the tables of a run, by file name."""
    return {path.name: path.read_bytes() for path in sorted((out / "tables").iterdir())}


def recorded(out: Path) -> Counter[str]:
    """How often each key stands in the journal."""
    return Counter(
        json.loads(line.partition(" ")[2])["key"]
        for shard in sorted((out / "journal").glob("*.jsonl"))
        for line in shard.read_text(encoding="utf-8").splitlines()
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Carry out the runs; 0 if all are as the one left alone."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--runs", type=int, default=50)
    parser.add_argument("--kills", type=int, default=1, help="of each run")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--budget", help="of the starts that are killed, as in bench run")
    chosen = parser.parse_args(arguments)
    rng = random.Random(chosen.seed)
    budget = ("--budget", chosen.budget) if chosen.budget else ()
    different = killed = 0
    with tempfile.TemporaryDirectory() as folder:
        alone = Path(folder) / "alone"
        span = run_to_the_end(alone)
        measure, keys = tables(alone), recorded(alone)
        print(f"left alone: {span:.1f} s, {len(keys)} jobs, {len(measure)} tables", flush=True)
        for number in range(1, chosen.runs + 1):
            out = Path(folder) / f"run-{number}"
            instants = [rng.uniform(0.0, span) for _ in range(chosen.kills)]
            cut = []
            for instant in instants:
                killed += run_and_kill(out, instant, budget)
                journal = out / "journal"
                cut.append(len(recorded(out)) if journal.is_dir() else 0)
            run_to_the_end(out)
            actual = recorded(out)
            faults = [
                *(["other tables"] if tables(out) != measure else []),
                *(["jobs lost"] if keys.keys() - actual.keys() else []),
                *(["other jobs"] if actual.keys() - keys.keys() else []),
                *(["jobs recorded twice"] if max(actual.values()) > 1 else []),
            ]
            different += bool(faults)
            when = ", ".join(
                f"{instant:.1f} s ({done} of {len(keys)} done)"
                for instant, done in zip(instants, cut, strict=True)
            )
            print(f"{number}: killed at {when}: {', '.join(faults) or 'the same'}", flush=True)
    print(f"{chosen.runs} runs, {killed} kills, {different} different")
    return int(different > 0)


if __name__ == "__main__":
    sys.exit(main())
