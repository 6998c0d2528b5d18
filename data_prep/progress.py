"""Progress on stderr: a live bar in a terminal, plain lines elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

PLAIN_EVERY_S = 15.0


def say(line: str) -> None:
    """A line of its own, between those of the progress."""
    print(line, file=sys.stderr, flush=True)


@contextmanager
def progress(title: str, total: int, *, quiet: bool = False) -> Iterator[Callable[[int], None]]:
    """Yields a function that takes the number of failed pieces so far, after each piece.

    `quiet` shows nothing: of several processes that work together one reports.
    """
    if quiet:
        yield lambda failed: None
    elif sys.stderr.isatty():
        with _live(title, total) as advance:
            yield advance
    else:
        yield _plain(title, total)


@contextmanager
def _live(title: str, total: int) -> Iterator[Callable[[int], None]]:
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[failed]} failed"),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True)) as bars:
        task = bars.add_task(title, total=total, failed=0)
        yield lambda failed: bars.update(task, advance=1, failed=failed)


def _plain(title: str, total: int) -> Callable[[int], None]:
    start = last = time.monotonic()
    done = 0

    def advance(failed: int) -> None:
        nonlocal done, last
        done += 1
        now = time.monotonic()
        if done < total and now - last < PLAIN_EVERY_S:
            return
        if failed == done == total:  # no progress; why not, the caller will say in one line
            return
        last = now
        left = (now - start) / done * (total - done)
        say(
            f"{title}: {done}/{total} done, {failed} failed, {now - start:.0f} s, "
            f"about {left:.0f} s left"
        )

    return advance
