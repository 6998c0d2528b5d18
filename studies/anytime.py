"""What a run would say had it been stopped: its own trade of time for certainty.

    python -m studies.anytime results/runs/chair-robustness-procedural -o anytime.png

Reads a finished run that was made in one start, and takes its objects in the order in which they
were completed. After each: the seconds since the start (times of the files of its jobs), and how
far the 95 % intervals of SSIM reach, in the median and at most over methods and conditions.
Prints a table at 1, 2 and 5 minutes and at the end, and draws the curve. The time for tables,
figures and report comes on top (`stage_seconds` in the manifest).
"""

from __future__ import annotations

import argparse
from datetime import datetime
from pathlib import Path
from statistics import median
from typing import NamedTuple

import pandas as pd

from bench.analysis.intervals import mean_interval
from bench.catalogue.methods import role
from bench.records.journal import read_finished
from bench.records.parquet import artifacts_of, read_jobs, read_records
from bench.tables.figure import panels, save
from studies.tables import markdown

AT_S = (60, 120, 300)


class Moment(NamedTuple):
    """What is known once so many objects are complete; intervals by their wider half."""

    objects: int
    seconds: float
    median: float
    widest: float


def completed(directory: Path) -> list[tuple[str, float]]:
    """Objects with the seconds from the run's start to the end of their last job, sorted."""
    started = datetime.fromisoformat(read_finished(directory)["started"]).timestamp()
    last: dict[str, float] = {}
    for artifact in artifacts_of(directory, read_jobs(directory)):
        ended = artifact.path.stat().st_mtime - started
        name = artifact.item.object_id
        last[name] = max(last.get(name, 0.0), ended)
    return sorted(last.items(), key=lambda pair: pair[1])


def moments(records: pd.DataFrame, order: list[tuple[str, float]]) -> list[Moment]:
    """From two objects on; floors and ceiling are left out."""
    methods = {name for name in records["method"].unique() if not role(name)}
    chosen = records[(records["outcome"] == "ok") & records["method"].isin(methods)]
    means = chosen.pivot_table(
        index="object", columns=["method", "condition"], values="ssim", aggfunc="mean"
    )
    made = []
    for count in range(2, len(order) + 1):
        part = means.reindex([name for name, _ in order[:count]])
        halves = []
        for cell in part:
            scores = part[cell].dropna().to_numpy()
            low, high = mean_interval(scores)
            halves.append(max(scores.mean() - low, high - scores.mean()))
        made.append(Moment(count, order[count - 1][1], median(halves), max(halves)))
    return made


def report(made: list[Moment]) -> str:
    """The last moment before each of `AT_S`, and the end."""
    rows = []
    for title, limit in [*((f"{s // 60} min", s) for s in AT_S), ("the end", float("inf"))]:
        before = [moment for moment in made if moment.seconds <= limit]
        if before:
            n, seconds, middle, widest = before[-1]
            rows.append([title, str(n), f"{seconds:.0f}", f"±{middle:.3f}", f"±{widest:.3f}"])
    return markdown(["after", "objects", "s", "SSIM, median interval", "widest"], rows)


def draw(made: list[Moment], path: Path) -> None:
    """The intervals, and the number of objects, over time."""
    figure, ((axis,),) = panels(1, 1, (6.4, 3.4))
    minutes = [moment.seconds / 60 for moment in made]
    for name, style in (("median", "-"), ("widest", "--")):
        axis.plot(minutes, [getattr(m, name) for m in made], style, color="tab:blue", label=name)
    axis.set(
        xlabel="minutes since the start", ylabel="SSIM: half of a 95 % interval", ylim=(0, None)
    )
    axis.legend(title="of all methods and conditions", loc="upper center")
    count = axis.twinx()
    count.plot(minutes, [moment.objects for moment in made], color="tab:orange")
    count.set_ylabel("objects", color="tab:orange")
    count.set_ylim(0, None)
    save(figure, path)


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("directory", type=Path)
    parser.add_argument("-o", "--out", type=Path, help="where to draw the curve")
    chosen = parser.parse_args()
    made = moments(read_records(chosen.directory), completed(chosen.directory))
    print(report(made))
    if chosen.out is not None:
        draw(made, chosen.out)


if __name__ == "__main__":
    main()
