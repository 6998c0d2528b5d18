"""How a run goes on, for whoever looks on: a live table on a terminal, plain lines elsewhere."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack
from types import TracebackType
from typing import Any

from bench.analysis.scores import QualityRow
from bench.running.run import PartialRun
from bench.tables.plain import plain
from bench.tables.table import TABLES, Table
from data_prep.progress import bars, is_live, log, progress

WIDEST, MOST_LINES = 100, 40
SHARE = 0.02  # of the time of a run that goes into tables in between, at most


def shown(table: Table[QualityRow], lines: int = MOST_LINES) -> list[str]:
    """The headline table as text, as wide as the terminal and at most 100 columns."""
    width = min(WIDEST, shutil.get_terminal_size((WIDEST, MOST_LINES)).columns)
    return [table.title, *plain(table.grids(), width, lines - 1)]


class Terminal(AbstractContextManager["Terminal"]):
    """An observer of a run (`bench.running.run.ProgressReporter`).

    make  the headline table of what is complete. It is made anew as objects are completed, unless
          that would take more than a fiftieth of the time
    """

    def __init__(
        self, make: Callable[[PartialRun], Table[QualityRow]], title: str, total: int
    ) -> None:
        self._make, self._title, self._total = make, title, total
        self._again = 0.0  # when the table may be made again
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
        """So many more jobs have ended."""
        if self._live is not None:
            self._bars.update(self._task, advance=ended, failed=failed)
            return
        for _ in range(ended):
            self._advance(failed)

    def on_object_done(self, snapshot: Callable[[], PartialRun]) -> None:
        """One more object is complete."""
        start = time.monotonic()
        if start < self._again:
            return
        complete = snapshot()
        table = self._make(complete)
        if self._live is not None:
            from rich.console import Group
            from rich.text import Text

            room = self._live.console.height - 4
            text = Text("\n".join(shown(table, min(room, MOST_LINES))), no_wrap=True)
            self._live.update(Group(text, Text(), self._bars))
        elif not self._again:
            log(f"headline table so far: {complete.directory / TABLES / table.name}.md")
        now = time.monotonic()
        self._again = now + (now - start) / SHARE
