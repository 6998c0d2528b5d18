"""Where tasks are done: in processes of this machine (`bench.running.isolation`), or on a cluster.

Tasks are idempotent, and what becomes of one depends on nothing but the task: an executor may do
one twice, on any machine, in any order.
"""

from __future__ import annotations

from collections.abc import Generator, Iterable, Iterator
from typing import Protocol, TypeVar

Task = TypeVar("Task")
TaskIn = TypeVar("TaskIn", contravariant=True)
Done = TypeVar("Done")
DoneOut = TypeVar("DoneOut", covariant=True)


class Executor(Protocol[TaskIn, DoneOut]):
    """Does tasks, several at a time."""

    @property
    def room(self) -> int:
        """How many tasks may be under way: enough to keep all workers busy, and not more."""
        ...

    def submit(self, task: TaskIn, /) -> None:
        """Have a task done."""
        ...

    def collect(self) -> Iterator[DoneOut]:
        """Wait until at least one of those under way has ended, and give what has."""
        ...

    def close(self) -> None:
        """Stop at once what is under way, and let go of all workers."""
        ...


def feed(tasks: Iterable[Task], executor: Executor[Task, Done]) -> Generator[Done, None, None]:
    """What becomes of each task, as it comes.

    Tasks are taken from their iterable as there is room; one that has ended is asked again after
    results, so that an iterable may wait for them before it goes on.
    """
    queue, under_way = iter(tasks), 0
    while True:
        while under_way < executor.room:
            try:
                task = next(queue)
            except StopIteration:
                break
            executor.submit(task)
            under_way += 1
        if not under_way:
            return
        for done in executor.collect():
            under_way -= 1
            yield done
