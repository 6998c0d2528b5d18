"""Tasks in killable worker processes: spawned, one library thread each, replaced now and then.

Native libraries hang, leak and crash (see CONTRIBUTING.md); such a task costs its own result and
nothing else. Tasks are idempotent, and a result depends on nothing but the task: an executor may do
a task twice, on any machine, in any order.
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
    """Compute on so many threads within the block; afterwards on as many as before."""
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
TASKS_PER_WORKER = 500  # then a fresh process, which ends every leak
QUEUED = 2  # tasks for each worker, the one that it does and the next: there may be 10^5 in all
START_S = 120.0  # for a worker to get ready, on a machine that swaps, too
_MOST_BREAKS = 3  # workers lost before they were ready, one after the other
_MOST_RESTING = 4  # workers, beyond those at work, that wait for further tasks of their company


def thread_counts(threads: int) -> dict[str, str]:
    """Return the environment in which libraries, when they are loaded, take so many threads."""
    libraries = ("OMP", "OPENBLAS", "MKL", "NUMEXPR", "LP")  # the last is Mesa's rasteriser
    return {f"{library}_NUM_THREADS": str(threads) for library in libraries}


# One thread a worker, so that no result depends on the number of workers: sums are taken in the
# same order.
WORKER_ENVIRONMENT = thread_counts(1) | {
    # MeshLab's APSS reads memory that it has not written: in about half of all processes some
    # vertices end up a rounding error away, and where the surface is ill-conditioned a spike more
    # or less moves SSIM by 0.05. With glibc filling what it hands out (255 is a fill of zeros)
    # and keeping no cache of freed blocks, every process reads the same.
    "GLIBC_TUNABLES": "glibc.malloc.perturb=255:glibc.malloc.tcache_count=0",
}


class Executor(Protocol):
    """A pool that does tasks, several at a time."""

    @property
    def capacity(self) -> int:
        """Return how many tasks may be under way: just enough to keep all workers busy."""
        ...

    def submit(self, task: Any, /) -> None:
        """Start a task."""

    def wait_any(self, timeout_s: float | None, /) -> Iterator[Any]:
        """Wait until tasks have ended, and yield their results; perhaps none, after `timeout_s`."""
        ...

    def close(self) -> None:
        """Stop all tasks at once, and let go of all workers."""


def submit_all(
    tasks: Iterable[Task | None],
    executor: Executor,
    left_s: Callable[[], float | None] = lambda: None,
) -> Generator[Any, None, None]:
    """Do tasks as the executor has capacity, and yield each result as it comes.

    A None in `tasks` means: wait until one running task has finished. When `left_s` gives zero or
    less, tasks that are under way are left to the executor's end.
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
    """A task whose worker had to be killed, or died, after so many seconds; None if unknown."""

    kind: Literal["timeout", "memory", "crash"]
    detail: str
    taken_s: float | None = field(default=None, compare=False)

    @property
    def reason(self) -> str:
        """Return the reason in a record, as in "timeout: no result within 120 s"."""
        return f"{self.kind}: {self.detail}"


@dataclass
class _Worker(Generic[Task]):
    process: WorkerProcess
    company: str  # what its tasks have in common
    deadline: float  # when to stop it, by the clock of its pool: for its start, then for each task
    ready: bool = False
    under_way: tuple[Task, ...] = ()  # the task that it does, or will get when it is ready
    begun: int = 0  # tasks that it was given


class TaskPool(Generic[Task, Result]):
    """Worker processes that do `work(task)`, one task at a time each.

    `work` and the tasks cross process boundaries: a function of a module, and plain values.
    `environment` is added to this process's own. A worker is replaced after `tasks_per_worker`
    tasks. Tasks of which `company` gives different texts never share a worker. Close a pool,
    whatever happens, before you make another.
    """

    def __init__(
        self,
        work: Callable[[Task], Result],
        workers: int,
        limits: Limits,
        environment: Mapping[str, str] = WORKER_ENVIRONMENT,
        tasks_per_worker: int = TASKS_PER_WORKER,
        company: Callable[[Task], str] = lambda task: "",
    ) -> None:
        if sys.platform != "linux":
            raise BadInput(
                f"worker processes need Linux, and this is {sys.platform}; use WSL 2 or Docker, or "
                "draw within a process by bench.draw_cloud (docs/platforms.md)"
            )
        # Only the watch on memory and the sending are other threads: tasks are handed out, and
        # workers stopped when their time is over, within `submit` and `wait_any`.
        self._work, self._size, self._limits = work, workers, limits
        self._tasks_per_worker, self._company = tasks_per_worker, company
        self._clock = RunningTime()
        self.capacity = QUEUED * workers
        self._queue: deque[Task] = deque()
        self._workers: list[_Worker[Task]] = []
        self._leaving: list[WorkerProcess] = []
        self._ended: deque[tuple[Task, bool, Any]] = deque()  # as a worker's answers
        self._breaks = 0
        self._around = ExitStack()
        self._around.enter_context(_environment({SAFE_PATH: "1", **environment}))
        keepers = lambda: [worker.process.pid for worker in self._workers]  # noqa: E731
        self._over_limit = self._around.enter_context(watched_memory(keepers, limits.memory_gib))
        atexit.register(self.close)  # else multiprocessing waits for the workers for ever

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
            worker = self._worker_for(self._company(task))
            worker.under_way = (task,)
            worker.begun += 1
            if worker.ready:
                self._send(worker)

    def _worker_for(self, company: str) -> _Worker[Task]:
        """Return an idle worker of a company, or a new one."""
        idle = [worker for worker in self._workers if not worker.under_way]
        for worker in idle:
            if worker.company == company:
                return worker
        companies = {company, *(worker.company for worker in self._workers)}
        if idle and len(self._workers) >= self._size + min(len(companies) - 1, _MOST_RESTING):
            self._let_go(idle[0])
        process = WorkerProcess(self._work, self._limits.memory_gib)
        worker = _Worker[Task](process, company, self._clock() + START_S)
        self._workers.append(worker)
        return worker

    def _send(self, worker: _Worker[Task]) -> None:
        worker.deadline = self._clock() + self._limits.time_s
        worker.process.send(*worker.under_way)

    def _wait(self, most_s: float) -> None:
        """Wait until a worker has something to say or has ended; at most for a tick."""
        processes = [worker.process for worker in self._workers]
        handles = [handle for p in processes for handle in (p.connection, p.sentinel)]
        first_s = min(worker.deadline for worker in self._workers) - self._clock()
        connection.wait(handles, max(0.0, min(first_s, most_s, TICK_S)))

    def _look_at(self, worker: _Worker[Task]) -> None:
        """Take a worker's answer where it has one, even after the deadline, or see to its end."""
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
        except BadInput:  # a ValueError, which `_lose` raises
            raise
        except (EOFError, OSError):
            self._lose(worker, self._exit_reason(process))
        except (pickle.UnpicklingError, ValueError, TypeError):  # a task wrote there itself
            process.stop()
            self._lose(worker, WorkerFailure("crash", "no answer that can be read"))

    def _take(self, worker: _Worker[Task], fine: bool, value: Any) -> None:
        if not worker.ready:  # it says that it is, and gets its first task
            worker.ready = True
            self._send(worker)
            return
        self._breaks = 0
        self._ended.append((worker.under_way[0], fine, value))
        worker.under_way, worker.deadline = (), float("inf")
        self._workers.remove(worker)
        self._workers.append(worker)  # who has rested for the longest comes first
        if worker.begun >= self._tasks_per_worker:
            self._let_go(worker)

    def _lose(self, worker: _Worker[Task], reason: WorkerFailure) -> None:
        """Go on without a worker that has ended or is stopped."""
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
        self._breaks += _MOST_BREAKS if is_late else 1  # a second one that hangs is enough
        if self._breaks > _MOST_BREAKS:
            raise BrokenProcessPool(
                f"workers were lost before they could begin, one after the other ({reason.reason})"
            )

    def _let_go(self, worker: _Worker[Task]) -> None:
        """Let an idle worker end by itself: libraries are unloaded, what they hold is freed."""
        self._remove(worker)
        worker.process.let_go()

    def _remove(self, worker: _Worker[Task]) -> None:
        self._leaving.append(worker.process)
        self._workers.remove(worker)
        self._leaving = [process for process in self._leaving if not process.has_ended]

    def _exit_reason(self, process: WorkerProcess) -> WorkerFailure:
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
        """Stop all workers at once; idle workers end by themselves."""
        for worker in tuple(self._workers):
            end = worker.process.stop if worker.under_way else worker.process.let_go
            end()
            self._remove(worker)
        for process in self._leaving:
            process.join()
        self._around.close()
        atexit.unregister(self.close)  # at last: what an interrupt leaves undone is done at exit


def run_tasks(
    tasks: Iterable[Task],
    work: Callable[[Task], Result],
    workers: int,
    limits: Limits,
    environment: Mapping[str, str] = WORKER_ENVIRONMENT,
    tasks_per_worker: int = TASKS_PER_WORKER,
) -> Generator[tuple[Task, Result | WorkerFailure], None, None]:
    """Yield each task with its result or its worker's failure, as they come (see `TaskPool`).

    Closing the iterator stops all workers at once.
    """
    with closing(TaskPool(work, workers, limits, environment, tasks_per_worker)) as pool:
        yield from submit_all(tasks, pool)


@contextmanager
def _environment(changes: Mapping[str, str]) -> Iterator[None]:
    before = {name: os.environ[name] for name in changes if name in os.environ}
    os.environ.update(changes)
    try:
        yield
    finally:
        for name in changes:
            os.environ.pop(name, None)
        os.environ.update(before)
