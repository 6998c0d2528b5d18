"""Progress on stderr: a live bar in a terminal, plain lines elsewhere.

`progress` counts pieces of work; `step_progress` shows what each step says of itself.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:  # a progress that is not live needs no rich
    from rich.progress import Progress

PLAIN_EVERY_S = 15.0  # between lines of `progress` where there is no terminal
_STEPS_EVERY_S = 30.0  # between lines of `step_progress` there: trainings take hours


def log(line: str) -> None:
    """Print a line on stderr, between the lines of the progress."""
    print(line, file=sys.stderr, flush=True)


@contextmanager
def progress(
    title: str,
    total: int,
    *,
    quiet: bool = False,
    above: Callable[[], Sequence[str]] | None = None,
) -> Iterator[Callable[[int], None]]:
    """Yield a function to be called after each piece with the number of failed pieces so far.

    `quiet` shows nothing: only one of several processes that work together reports. `above` returns
    lines that stand above a bar in a terminal; both are gone at the end.
    """
    if quiet:
        yield lambda failed: None
    elif is_live():
        with _bars(above) as shown:
            task = shown.add_task(title, total=total, failed=0)
            yield lambda failed: shown.update(task, advance=1, failed=failed)
    else:
        yield _plain(title, total)


class Step(Protocol):
    """A step of `steps`; its text says what there is to say of it."""

    @property
    def step(self) -> int:
        """The steps that are done."""
        ...

    @property
    def steps(self) -> int:
        """The steps in all."""
        ...


@contextmanager
def step_progress(title: str, *, quiet: bool = False) -> Iterator[Callable[[Step], None]]:
    """Yield a function to be called with a step of long work.

    Where stderr is no terminal: a line at the first call, then at most one every 30 seconds, and
    one at the last step. `quiet` shows nothing.
    """
    if quiet:
        yield lambda step: None
    elif is_live():
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn

        columns = TextColumn("{task.description}"), BarColumn(30), TextColumn("{task.fields[text]}")
        with Progress(*columns, console=Console(stderr=True)) as shown:
            task = shown.add_task(title, text="")
            yield lambda step: shown.update(
                task, completed=step.step, total=step.steps, text=str(step)
            )
    else:
        last = float("-inf")

        def show(step: Step) -> None:
            nonlocal last
            now = time.monotonic()
            if step.step == step.steps or now - last >= _STEPS_EVERY_S:
                last = now
                log(f"{title}: {step}")

        yield show


def is_live() -> bool:
    """Return whether stderr is a terminal on which lines can be redrawn."""
    if not sys.stderr.isatty():
        return False
    from rich.console import Console

    console = Console(stderr=True)
    return console.is_terminal and not console.is_dumb_terminal


def _bars(above: Callable[[], Sequence[str]] | None) -> Progress:
    """Return bars on stderr with a column for the field `failed` of a task."""
    from rich.console import Console, RenderableType
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )
    from rich.text import Text

    class Bars(Progress):
        def get_renderables(self) -> Iterator[RenderableType]:
            if above is not None and (lines := above()):
                yield Text("\n".join(lines) + "\n", no_wrap=True)
            yield from super().get_renderables()

    return Bars(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[failed]} failed"),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
        console=Console(stderr=True),
        transient=above is not None,
    )


def _plain(title: str, total: int) -> Callable[[int], None]:
    start = last = time.monotonic()
    done = 0

    def advance(failed: int) -> None:
        nonlocal done, last
        done += 1
        now = time.monotonic()
        if done < total and now - last < PLAIN_EVERY_S:
            return
        if failed == done == total:  # no progress: the caller reports the reason in one line
            return
        last = now
        left = (now - start) / done * (total - done)
        log(
            f"{title}: {done}/{total} done, {failed} failed, {now - start:.0f} s, "
            f"about {left:.0f} s left"
        )

    return advance
