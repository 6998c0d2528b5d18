"""The progress of a run on stderr: a live table on a terminal, plain lines elsewhere."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack
from functools import partial
from typing import Any

import pandas as pd

from bench.analysis.run import Run, full_frame, unmeasured
from bench.catalogue.metrics import is_mean
from bench.catalogue.suites import stored_suite
from bench.running.run import PartialRun, Watch
from bench.tables.quality import headline
from bench.tables.table import TABLES, Table, write_tables
from bench.tables.terminal import grid_lines, laid_out, terminal_width
from data_prep.progress import is_live, log, progress

WIDEST, MOST_LINES = 100, 40  # the most columns and lines of the headline table on a terminal
SHARE = 0.02  # the largest share of a run's time that goes into making headline tables meanwhile


def shown(table: Table, lines: int = MOST_LINES) -> list[str]:
    """Return the headline table as lines of text, as wide as the terminal, at most 100 columns."""
    width = min(WIDEST, terminal_width(WIDEST))
    title = laid_out([table.title], width)
    return [*title, *grid_lines(table.grids(), width, lines - len(title))]


class LiveTable:
    """The headline table of a run that is under way, by the objects that are complete."""

    def __init__(self) -> None:
        self._jobs: dict[str, pd.DataFrame] = {}  # the jobs read so far, by the name of the object

    def table(self, snapshot: PartialRun) -> Table:
        """Write the table of the complete objects into the folder of tables, and return it."""
        manifest, suite = snapshot.manifest, stored_suite(snapshot.manifest)
        means = [metric for metric in suite.headline if is_mean(metric)]
        for name in [name for name in manifest["objects"] if name not in self._jobs]:
            self._jobs[name] = snapshot.read_jobs(name)
        jobs = full_frame(pd.concat(self._jobs.values()), manifest)
        skipped = unmeasured(jobs, manifest.get("skipped_metrics", {}))
        table = headline(Run(snapshot.directory, suite, manifest, jobs, skipped=skipped), means)
        write_tables(snapshot.directory, [table])
        return table


def watching() -> Watch:
    """Return a function that makes the reporter of a run's progress and of its headline table."""
    return partial(Terminal, LiveTable().table)


class Terminal(AbstractContextManager["Terminal"]):
    """A progress reporter of a run (`bench.running.run.ProgressReporter`).

    As objects are completed, it calls `make`, which returns the headline table of the complete
    objects; but so seldom that this takes at most `SHARE` of the time.
    """

    def __init__(self, make: Callable[[PartialRun], Table], title: str, total: int) -> None:
        self._make, self._title, self._total = make, title, total
        # The time of `time.monotonic` before which the table is not made again; 0 before the first.
        self._next_s = 0.0
        self._lines: list[str] = []  # the table, which is shown above the progress bar
        self._around = ExitStack()

    def __enter__(self) -> Terminal:
        self._live = is_live()
        bar = progress(self._title, self._total, above=lambda: self._lines)
        self._advance = self._around.enter_context(bar)
        return self

    def __exit__(self, *error: Any) -> None:
        self._around.close()

    def on_jobs_done(self, ended: int, failed: int) -> None:
        """Count jobs that have ended, and show how many have failed so far."""
        for _ in range(ended):
            self._advance(failed)

    def on_object_done(self, snapshot: Callable[[], PartialRun]) -> None:
        """Show the headline table of the complete objects, if it is time for one."""
        start = time.monotonic()
        if start < self._next_s:
            return
        partial_run = snapshot()
        table = self._make(partial_run)
        if self._live:
            height = shutil.get_terminal_size().lines
            self._lines = shown(table, min(height - 4, MOST_LINES))
        elif not self._next_s:
            log(f"headline table so far: {partial_run.directory / TABLES / table.name}.md")
        now = time.monotonic()
        self._next_s = now + (now - start) / SHARE
