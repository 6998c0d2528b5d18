"""Worker processes that do tasks, and can be killed.

Native libraries hang, leak and crash (see CONTRIBUTING.md). Here such a task costs its own result
and nothing else: workers are fresh processes, killed where a task exceeds its limits, and replaced
after some hundred tasks. Each computes with one thread. A result depends on nothing but the task,
and a task can be done again, so that an executor may do it twice, on any machine, in any order.
"""

from __future__ import annotations

import atexit
import os
import pickle
import signal
import sys
import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, field, replace
from itertools import islice
from multiprocessing import connection
from typing import Any, Generic, Literal, Protocol, TypeVar

from bench.catalogue.suites import Limits
from bench.running.worker import (
    NO_GUARD,
    SAFE_PATH,
    TICK_S,
    RunningTime,
    WorkerProcess,
    watched_memory,
)
from data_prep.failures import BadInput


@contextmanager
def library_threads(count: int) -> Iterator[None]:
    """Have libraries compute with so many threads within the block, and as before after it."""
    import torch
    from threadpoolctl import threadpool_limits

    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        with threadpool_limits(count):
            yield
    finally:
        torch.set_num_threads(before)


Task = TypeVar("Task")
Result = TypeVar("Result")
# The number of tasks after which a worker is replaced by a fresh process, which ends every leak.
TASKS_PER_WORKER = 500
# The tasks that an executor takes for each worker: the one under way, and the next, so that no
# worker idles. The others, perhaps 10^5, are not even made until then.
QUEUED = 2
START_S = 120.0  # seconds that a worker may take to get ready, even on a machine that swaps
_MOST_BREAKS = 3  # workers that may be lost, one after the other, before they were ready
_MOST_RESTING = 4  # idle workers that are kept for further tasks of their group


def thread_counts(threads: int) -> dict[str, str]:
    """Return the environment variables by which libraries compute with so many threads."""
    libraries = ("OMP", "OPENBLAS", "MKL", "NUMEXPR", "LP")  # LP is Mesa's rasteriser
    return {f"{library}_NUM_THREADS": str(threads) for library in libraries}


# Each worker computes with one thread, so that sums are taken in the same order and no result
# depends on the number of workers.
WORKER_ENVIRONMENT = thread_counts(1) | {
    # MeshLab's APSS reads memory that it has not written: in about half of all processes some
    # vertices end up a rounding error away, and where the surface is ill-conditioned a spike more
    # or less moves SSIM by 0.05. With these settings glibc fills the memory that it hands out (255
    # stands for zeros) and keeps no cache of freed blocks, so that every process reads the same.
    "GLIBC_TUNABLES": "glibc.malloc.perturb=255:glibc.malloc.tcache_count=0",
}


class Executor(Protocol):
    """A pool that does tasks, several at a time."""

    @property
    def capacity(self) -> int:
        """Return how many tasks may be under way, which is just enough to keep all workers busy."""
        ...

    def submit(self, task: Any, /) -> None:
        """Start a task."""

    def wait_any(self, timeout_s: float | None, /) -> Iterator[Any]:
        """Wait until tasks have ended, and yield their results; none after `timeout_s` seconds."""
        ...

    def close(self) -> None:
        """Stop all tasks at once, and end all workers."""


def submit_all(
    tasks: Iterable[Task | None],
    executor: Executor,
    left_s: Callable[[], float | None] = lambda: None,
) -> Generator[Any, None, None]:
    """Do tasks as far as the executor has capacity, and yield each result as it comes.

    tasks   the tasks; where it gives None, a task under way has to end before it is asked again
    left_s  returns the seconds that are left, None for no limit; where that is zero or less,
            nothing more is yielded, and tasks under way go on until the executor is closed
    """
    queue, under_way = iter(tasks), 0
    while (seconds := left_s()) is None or seconds > 0:
        for task in islice(queue, max(0, executor.capacity - under_way)):
            if task is None:
                break
            executor.submit(task)
            under_way += 1
        if not under_way:
            return
        for done in executor.wait_any(seconds):
            under_way -= 1
            yield done


@dataclass(frozen=True)
class WorkerFailure:
    """The failure of a task whose worker had to be killed, or died."""

    kind: Literal["timeout", "memory", "crash"]
    detail: str
    taken_s: float | None = field(default=None, compare=False)  # seconds until then; None: unknown

    @property
    def reason(self) -> str:
        """Return the reason as records have it, as in "timeout: no result within 120 s"."""
        return f"{self.kind}: {self.detail}"


@dataclass
class _Worker(Generic[Task]):
    process: WorkerProcess
    group: str  # the group of all its tasks
    # When the worker is stopped, by the clock of its pool, because it is not ready or because it
    # has no result of its task.
    deadline: float
    ready: bool = False
    under_way: tuple[Task, ...] = ()  # at most one task, which waits while the worker gets ready
    begun: int = 0  # the number of tasks that the worker was given


class TaskPool(Generic[Task, Result]):
    """Worker processes that do `work(task)`, one task at a time each.

    work              a function of a module; it and the tasks, plain values, cross processes
    workers           how many processes work at a time, at most
    environment       variables that workers have beside those of this process
    tasks_per_worker  the number of tasks after which a worker is replaced
    group             returns the group of a task; tasks of different groups never share a worker

    Close a pool, whatever happens, before you make another.
    """

    def __init__(
        self,
        work: Callable[[Task], Result],
        workers: int,
        limits: Limits,
        environment: Mapping[str, str] = WORKER_ENVIRONMENT,
        tasks_per_worker: int = TASKS_PER_WORKER,
        group: Callable[[Task], str] = lambda task: "",
    ) -> None:
        if sys.platform != "linux":
            raise BadInput(
                f"worker processes need Linux, and this is {sys.platform}; use WSL 2 or Docker, or "
                "draw within a process by bench.draw_cloud (docs/platforms.md)"
            )
        # Memory is watched, and tasks are sent, by threads of their own. All else happens within
        # `submit` and `wait_any`: there tasks are handed out, and late workers are stopped.
        self._work, self._size, self._limits = work, workers, limits
        self._tasks_per_worker, self._group = tasks_per_worker, group
        self._clock = RunningTime()
        self.capacity = QUEUED * workers
        self._queue: deque[Task] = deque()
        self._workers: list[_Worker[Task]] = []
        self._leaving: list[WorkerProcess] = []  # processes that have no task, and are ending
        # The tasks that have ended: with True and the result, or with False and an exception.
        self._ended: deque[tuple[Task, bool, Any]] = deque()
        self._breaks = 0  # workers lost before they were ready, since one last gave a result
        self._around = ExitStack()
        self._around.enter_context(_environment({SAFE_PATH: "1", **environment}))
        keepers = lambda: [worker.process.pid for worker in self._workers]  # noqa: E731
        self._over_limit = self._around.enter_context(watched_memory(keepers, limits.memory_gib))
        # At the end of this process `multiprocessing` waits for all workers, which would not end.
        atexit.register(self.close)

    def submit(self, task: Task) -> None:
        """Start a task; at most `capacity` may be under way."""
        self._queue.append(task)
        self._hand_out()

    def wait_any(
        self, timeout_s: float | None = None
    ) -> Iterator[tuple[Task, Result | WorkerFailure]]:
        """Wait until tasks have ended, and yield each with its result or its worker's failure.

        An exception of `work` is raised here, and BrokenProcessPool where one worker after another
        is lost before it is ready.
        """
        end = time.monotonic() + (float("inf") if timeout_s is None else timeout_s)
        while not self._ended and (self._queue or any(w.under_way for w in self._workers)):
            if (left_s := end - time.monotonic()) < 0:
                return
            self._hand_out()
            self._wait(left_s)
            for worker in tuple(self._workers):
                self._look_at(worker)
            self._hand_out()  # before the results are looked at, which may take long
        while self._ended:
            task, fine, value = self._ended.popleft()
            if not fine:
                raise value
            yield task, value

    def _hand_out(self) -> None:
        """Give tasks to idle workers, and to new ones, which get theirs when they are ready."""
        for worker in [w for w in self._workers if not w.under_way]:
            self._look_at(worker)  # it may have died
        while self._queue and sum(len(w.under_way) for w in self._workers) < self._size:
            task = self._queue.popleft()
            worker = self._worker_for(self._group(task))
            worker.under_way = (task,)
            worker.begun += 1
            if worker.ready:
                self._send(worker)

    def _worker_for(self, group: str) -> _Worker[Task]:
        """Return an idle worker for tasks of a group, or a new one.

        Where there are many workers, a new one takes the place of an idle one of another group.
        """
        idle = [worker for worker in self._workers if not worker.under_way]
        for worker in idle:
            if worker.group == group:
                return worker
        other_groups = {worker.group for worker in self._workers} - {group}
        most = self._size + min(len(other_groups), _MOST_RESTING)
        if idle and len(self._workers) >= most:
            self._let_go(idle[0])
        process = WorkerProcess(self._work, self._limits.memory_gib)
        worker = _Worker[Task](process, group, self._clock() + START_S)
        self._workers.append(worker)
        return worker

    def _send(self, worker: _Worker[Task]) -> None:
        """Send a worker its task, and set the deadline for the result."""
        worker.deadline = self._clock() + self._limits.time_s
        worker.process.send(*worker.under_way)

    def _wait(self, most_s: float) -> None:
        """Wait until a worker has an answer, has ended or is late; at most `most_s` or a tick."""
        processes = [worker.process for worker in self._workers]
        handles = [handle for p in processes for handle in (p.connection, p.sentinel)]
        first_s = min(worker.deadline for worker in self._workers) - self._clock()
        connection.wait(handles, max(0.0, min(first_s, most_s, TICK_S)))

    def _look_at(self, worker: _Worker[Task]) -> None:
        """Take a worker's answer, or go on without the worker where it has ended or is late.

        An answer is taken even after the deadline.
        """
        process = worker.process
        try:
            if process.connection.poll():
                self._take(worker, *process.connection.recv())
            elif process.has_ended:
                self._lose(worker, self._exit_reason(process))
            elif self._clock() > worker.deadline:
                process.stop()
                limit = f"no result within {self._limits.time_s:g} s"
                late = limit if worker.ready else f"not ready within {START_S:g} s"
                self._lose(worker, WorkerFailure("timeout", late))
        except BadInput:  # raised by `_lose`; it is a ValueError, which the last clause catches
            raise
        except (EOFError, OSError):
            self._lose(worker, self._exit_reason(process))
        except (pickle.UnpicklingError, ValueError, TypeError):
            # What was sent is no answer of ours: the task itself wrote into the connection.
            process.stop()
            self._lose(worker, WorkerFailure("crash", "no answer that can be read"))

    def _take(self, worker: _Worker[Task], fine: bool, value: Any) -> None:
        """Take a worker's answer: the first says that it is ready, the others are results."""
        if not worker.ready:
            worker.ready = True
            self._send(worker)
            return
        self._breaks = 0
        self._ended.append((worker.under_way[0], fine, value))
        worker.under_way, worker.deadline = (), float("inf")
        self._workers.remove(worker)
        self._workers.append(worker)  # so the worker that has been idle for the longest is first
        if worker.begun >= self._tasks_per_worker:
            self._let_go(worker)

    def _lose(self, worker: _Worker[Task], reason: WorkerFailure) -> None:
        """Go on without a worker that has ended or is stopped.

        Where it had begun its task, the task has failed; otherwise another worker will do it.
        Raises BrokenProcessPool where one worker after another is lost before it is ready, and
        BadInput where the script that started the pool has no guard against starting it again.
        """
        self._remove(worker)
        worker.process.join()
        if not worker.ready and worker.process.exit_code() == NO_GUARD:
            raise BadInput(
                "workers load the script that starts them, and it starts workers when it is "
                'loaded; call it below if __name__ == "__main__": (docs/python.md)'
            )
        if not worker.under_way:
            return
        is_late = reason.kind == "timeout"
        if worker.ready and (is_late or worker.process.was_reached()):
            self._breaks = 0
            taken_s = self._clock() - (worker.deadline - self._limits.time_s)
            self._ended.append((worker.under_way[0], True, replace(reason, taken_s=taken_s)))
            return
        self._queue.extendleft(worker.under_way)
        # A worker that hangs at its start has cost minutes, so that a second one is enough.
        self._breaks += _MOST_BREAKS if is_late else 1
        if self._breaks > _MOST_BREAKS:
            raise BrokenProcessPool(
                f"workers were lost before they could begin, one after the other ({reason.reason})"
            )

    def _let_go(self, worker: _Worker[Task]) -> None:
        """Let an idle worker end by itself, so that its libraries can free what they hold."""
        self._remove(worker)
        worker.process.let_go()

    def _remove(self, worker: _Worker[Task]) -> None:
        """Count a worker among those that are ending."""
        self._leaving.append(worker.process)
        self._workers.remove(worker)
        self._leaving = [process for process in self._leaving if not process.has_ended]

    def _exit_reason(self, process: WorkerProcess) -> WorkerFailure:
        """Return why a worker has ended: killed for its use of memory, or by itself."""
        code = process.exit_code()
        if process.pid in self._over_limit:
            most = f"{self._limits.memory_gib:g} GiB"
            return WorkerFailure("memory", f"the worker used more than {most}")
        try:
            ending = signal.Signals(-code).name if code < 0 else f"exit code {code}"
        except ValueError:
            ending = f"signal {-code}"
        return WorkerFailure("crash", f"the worker died ({ending})")

    def close(self) -> None:
        """Stop all workers that do a task at once, and let idle ones end by themselves."""
        for worker in tuple(self._workers):
            end = worker.process.stop if worker.under_way else worker.process.let_go
            end()
            self._remove(worker)
        for process in self._leaving:
            process.join()
        self._around.close()
        # Last, because an interrupt may end this function: then `close` is called again at exit.
        atexit.unregister(self.close)


def run_tasks(
    tasks: Iterable[Task | None],
    work: Callable[[Task], Result],
    workers: int,
    limits: Limits,
    environment: Mapping[str, str] = WORKER_ENVIRONMENT,
    tasks_per_worker: int = TASKS_PER_WORKER,
) -> Generator[tuple[Task, Result | WorkerFailure], None, None]:
    """Do tasks in worker processes, and yield each with its result or its worker's failure.

    The parameters are those of `submit_all` and `TaskPool`. Results come in the order in which
    tasks end. Closing the iterator stops all workers at once.
    """
    with closing(TaskPool(work, workers, limits, environment, tasks_per_worker)) as pool:
        yield from submit_all(tasks, pool)


@contextmanager
def _environment(changes: Mapping[str, str]) -> Iterator[None]:
    """Set environment variables of this process within the block, as before after it."""
    before = {name: os.environ[name] for name in changes if name in os.environ}
    os.environ.update(changes)
    try:
        yield
    finally:
        for name in changes:
            os.environ.pop(name, None)
        os.environ.update(before)
