"""Progress of a training on standard error: a live line on a terminal, else plain lines."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table

from data_prep.progress import log
from learning.training_loop import OnProgress, StepReport

PLAIN_EVERY_S = 30.0


@contextmanager
def training_progress(title: str, *, quiet: bool = False) -> Iterator[OnProgress]:
    """Yield the function that a training takes as `on_progress`.

    Where standard error is not a terminal: one line at the first report, then at most one every 30
    seconds, and one at the last step. `quiet` shows nothing.
    """
    if quiet:
        yield lambda report: None
    elif sys.stderr.isatty():
        with Live(console=Console(stderr=True)) as live:
            yield lambda report: live.update(_bar(title, report))
    else:
        yield _plain(title)


def _plain(title: str) -> OnProgress:
    last_s = float("-inf")

    def show(report: StepReport) -> None:
        nonlocal last_s
        now = time.monotonic()
        if report.step == report.steps or now - last_s >= PLAIN_EVERY_S:
            last_s = now
            log(f"{title}: {describe(report)}")

    return show


def _bar(title: str, report: StepReport) -> Table:
    table = Table.grid(padding=(0, 1))
    bar = ProgressBar(total=report.steps, completed=report.step, width=30)
    table.add_row(title, bar, describe(report))
    return table


def describe(report: StepReport) -> str:
    """Return the report as "step 120/2000, chamfer 0.0312, 98.1 images/s, 0:10:12 left"."""
    parts = [f"step {report.step}/{report.steps}"]
    parts += [f"{name} {value:.4g}" for name, value in report.losses.items()]
    if report.images_per_s is not None and report.seconds_left is not None:
        minutes, seconds = divmod(round(report.seconds_left), 60)
        hours, minutes = divmod(minutes, 60)
        parts += [f"{report.images_per_s:.1f} images/s", f"{hours}:{minutes:02}:{seconds:02} left"]
    return ", ".join(parts)
