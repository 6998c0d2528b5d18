"""Progress of a training run on standard error: a live line on a terminal, else plain lines."""

from __future__ import annotations

import sys
import time
from types import TracebackType

from rich.console import Console
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table

from learning.training_loop import StepReport

PLAIN_EVERY_S = 30.0


class ConsoleProgress:
    """A context manager to be handed to a training function as `on_progress`.

    Where standard error is not a terminal: one line at the first report, then at most one every 30
    seconds, and one at the last step. `quiet` shows nothing.
    """

    def __init__(self, title: str, *, quiet: bool = False) -> None:
        self.title = title
        self.quiet = quiet
        self.console = Console(stderr=True)
        shown = sys.stderr.isatty() and not quiet
        self.live = Live(console=self.console, transient=False) if shown else None
        self.last_plain_s = float("-inf")

    def __enter__(self) -> ConsoleProgress:
        if self.live:
            self.live.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if self.live:
            self.live.stop()

    def __call__(self, report: StepReport) -> None:
        """Show a report."""
        if self.quiet:
            return
        if self.live:
            self.live.update(self._table(report))
            return
        now = time.monotonic()
        if report.step == report.steps or now - self.last_plain_s >= PLAIN_EVERY_S:
            self.last_plain_s = now
            print(f"{self.title}: {describe(report)}", file=sys.stderr, flush=True)

    def _table(self, report: StepReport) -> Table:
        table = Table.grid(padding=(0, 1))
        bar = ProgressBar(total=report.steps, completed=report.step, width=30)
        table.add_row(self.title, bar, describe(report))
        return table


def describe(report: StepReport) -> str:
    """`step 120/2000, chamfer 0.0312, 98.1 images/s, 0:10:12 left`."""
    parts = [f"step {report.step}/{report.steps}"]
    parts += [f"{name} {value:.4g}" for name, value in report.losses.items()]
    if report.images_per_s is not None and report.seconds_left is not None:
        minutes, seconds = divmod(round(report.seconds_left), 60)
        hours, minutes = divmod(minutes, 60)
        parts += [f"{report.images_per_s:.1f} images/s", f"{hours}:{minutes:02}:{seconds:02} left"]
    return ", ".join(parts)
