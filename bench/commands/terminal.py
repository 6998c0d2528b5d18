"""The progress of a run on stderr: a live table on a terminal, plain lines elsewhere."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack
from types import TracebackType
from typing import Any

from bench.analysis.scores import QualityRow
from bench.running.run import PartialRun
from bench.tables.plain import plain
from bench.tables.table import TABLES, Table
from bench.tables.wrap import terminal_width, wrapped
from data_prep.progress import bars, is_live, log, progress

WIDEST, MOST_LINES = 100, 40
SHARE = 0.02  # of the time of a run that goes into tables in between, at most


def shown(table: Table[Any], lines: int = MOST_LINES) -> list[str]:
    """Return the headline table as text, as wide as the terminal and at most 100 columns."""
    width = min(WIDEST, terminal_width(WIDEST))
    title = wrapped(table.title, width)
    return [*title, *plain(table.grids(), width, lines - len(title))]


class Terminal(AbstractContextManager["Terminal"]):
    """A progress reporter of a run (`bench.running.run.ProgressReporter`).

    The headline table is made again as objects are completed, unless that would take more than a
    fiftieth of the time.

    Parameters
    ----------
    make : callable
        Returns the headline table of the complete objects.
    title, total
        Text before the bar, and number of jobs.
    """

    def __init__(
        self, make: Callable[[PartialRun], Table[QualityRow]], title: str, total: int
    ) -> None:
        self._make, self._title, self._total = make, title, total
        self._next_s = 0.0  # by `time.monotonic`; before it the table is not made again
        self._live: Any = None
        self._around = ExitStack()

    def __enter__(self) -> Terminal:
        if is_live():
            from rich.live import Live

            self._bars = bars()
            self._task = self._bars.add_task(self._title, total=self._total, failed=0)
            self._live = Live(self._bars, console=self._bars.console, transient=True)
            self._around.enter_context(self._live)
        else:
            self._advance = self._around.enter_context(progress(self._title, self._total))
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._around.close()

    def on_jobs_done(self, ended: int, failed: int) -> None:
        """Count jobs that have ended, and show how many have failed so far."""
        if self._live is not None:
            self._bars.update(self._task, advance=ended, failed=failed)
            return
        for _ in range(ended):
            self._advance(failed)

    def on_object_done(self, snapshot: Callable[[], PartialRun]) -> None:
        """Show the headline table of the complete objects, if it is time for one."""
        start = time.monotonic()
        if start < self._next_s:
            return
        partial_run = snapshot()
        table = self._make(partial_run)
        if self._live is not None:
            from rich.console import Group
            from rich.text import Text

            lines = min(self._live.console.height - 4, MOST_LINES)
            text = Text("\n".join(shown(table, lines)), no_wrap=True)
            self._live.update(Group(text, Text(), self._bars))
        elif not self._next_s:
            log(f"headline table so far: {partial_run.directory / TABLES / table.name}.md")
        now = time.monotonic()
        self._next_s = now + (now - start) / SHARE
