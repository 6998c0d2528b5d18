"""Tasks in killable worker processes: spawned, one library thread each, replaced now and then.

Native libraries hang, leak and crash (see CONTRIBUTING.md); such a task costs its own result and
nothing else. Tasks are idempotent, and a result depends on nothing but the task: an executor may do
a task twice, on any machine, in any order.
"""

from __future__ import annotations

import atexit
import os
import signal
import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from itertools import islice
from multiprocessing import connection
from typing import Any, Generic, Literal, Protocol, TypeVar

from bench.catalogue.suites import Limits
from bench.running.worker_process import SAFE_PATH, WorkerProcess, watched_memory


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
TaskIn = TypeVar("TaskIn", contravariant=True)
Done = TypeVar("Done")
DoneOut = TypeVar("DoneOut", covariant=True)


class Executor(Protocol[TaskIn, DoneOut]):
    """A pool that does tasks, several at a time."""

    @property
    def capacity(self) -> int:
        """Return how many tasks may be under way: just enough to keep all workers busy."""
        ...

    def submit(self, task: TaskIn, /) -> None:
        """Start a task."""
        ...

    def wait_any(self) -> Iterator[DoneOut]:
        """Wait until at least one task has ended, and yield the results of those that have."""
        ...

    def close(self) -> None:
        """Stop all tasks at once, and let go of all workers."""
        ...


def submit_all(
    tasks: Iterable[Task | None], executor: Executor[Task, Done]
) -> Generator[Done, None, None]:
    """Do tasks as the executor has capacity, and yield each result as it comes.

    A None in `tasks` means: wait until one running task has finished.
    """
    queue, under_way = iter(tasks), 0
    while True:
        for task in islice(queue, max(0, executor.capacity - under_way)):
            if task is None:
                break
            executor.submit(task)
            under_way += 1
        if not under_way:
            return
        for done in executor.wait_any():
            under_way -= 1
            yield done


Result = TypeVar("Result")

TASKS_PER_WORKER = 500  # then a fresh process, which ends every leak
LONGEST_WAIT_S = 3600.0  # more overflows in the system call for limits without end
QUEUED = 2  # tasks for each worker, the one that it does and the next: there may be 10^5 in all
START_S = 120.0  # for a worker to get ready, on a machine that swaps, too
MOST_BREAKS = 3  # workers lost before they were ready, one after the other


def thread_counts(threads: int) -> dict[str, str]:
    """Return the environment in which libraries, when they are loaded, take so many threads."""
    names = (
        *("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS"),
        "LP_NUM_THREADS",  # Mesa's software rasteriser
    )
    return dict.fromkeys(names, str(threads))


# One thread a worker, so that no result depends on the number of workers: sums are taken in the
# same order.
WORKER_ENVIRONMENT = thread_counts(1) | {
    # MeshLab's APSS reads memory that it has not written: in about half of all processes some
    # vertices end up a rounding error away, and where the surface is ill-conditioned a spike more
    # or less moves SSIM by 0.05. With glibc filling what it hands out (255 is a fill of zeros)
    # and keeping no cache of freed blocks, every process reads the same.
    "GLIBC_TUNABLES": "glibc.malloc.perturb=255:glibc.malloc.tcache_count=0",
}


@dataclass(frozen=True)
class WorkerFailure:
    """A task whose worker had to be killed, or died."""

    kind: Literal["timeout", "memory", "crash"]
    detail: str

    @property
    def reason(self) -> str:
        """Return the reason in a record, as in "timeout: no result within 120 s"."""
        return f"{self.kind}: {self.detail}"


@dataclass
class _Worker(Generic[Task]):
    """A worker of a pool.

    Attributes
    ----------
    deadline : float
        When to stop it, by `time.monotonic`, which nobody sets: for its start, then for each task.
    ready : bool
        Whether it has started.
    under_way : tuple
        The task that it was given; empty where it is idle.
    begun : int
        How many tasks it was given.
    """

    process: WorkerProcess
    deadline: float
    ready: bool = False
    under_way: tuple[Task, ...] = ()
    begun: int = 0


class TaskPool(Generic[Task, Result]):
    """Worker processes that do `work(task)`, one task at a time each.

    `work` and the tasks cross process boundaries: a function of a module, and plain values.
    `environment` is added to this process's own. A worker is replaced after `tasks_per_worker`
    tasks. Close a pool, whatever happens, before you make another.
    """

    def __init__(
        self,
        work: Callable[[Task], Result],
        workers: int,
        limits: Limits,
        environment: Mapping[str, str] = WORKER_ENVIRONMENT,
        tasks_per_worker: int = TASKS_PER_WORKER,
    ) -> None:
        # Only the watch on memory is another thread: tasks are handed out, and workers stopped when
        # their time is over, within `submit` and `wait_any`.
        self._work, self._size, self._limits = work, workers, limits
        self._tasks_per_worker = tasks_per_worker
        self.capacity = QUEUED * workers
        self._queue: deque[Task] = deque()
        self._workers: list[_Worker[Task]] = []
        self._leaving: list[WorkerProcess] = []
        self._ended: deque[tuple[Task, bool, Any]] = deque()  # as a worker's answers
        self._breaks = 0
        self._around = ExitStack()
        self._around.enter_context(_environment({SAFE_PATH: "1", **environment}))
        self._over_limit = self._around.enter_context(
            watched_memory(self._process_ids, limits.memory_gib)
        )
        atexit.register(self.close)  # else multiprocessing waits for the workers for ever

    def _process_ids(self) -> list[int]:
        return [worker.process.pid for worker in self._workers]

    def submit(self, task: Task) -> None:
        """Start a task; at most `capacity` may be under way."""
        self._queue.append(task)
        self._hand_out()

    def wait_any(self) -> Iterator[tuple[Task, Result | WorkerFailure]]:
        """Wait until tasks have ended, and yield each with its result or its worker's failure.

        An exception of `work` is raised here, and BrokenProcessPool where one worker after another
        is lost before it is ready.
        """
        while not self._ended and (self._queue or any(w.under_way for w in self._workers)):
            self._hand_out()
            self._wait()
            for worker in tuple(self._workers):
                self._look_at(worker)
            self._hand_out()  # before the results are looked at, which may take long
        while self._ended:
            task, fine, value = self._ended.popleft()
            if not fine:
                raise value
            yield task, value

    def _hand_out(self) -> None:
        """Give tasks to idle workers, and to new ones, which find theirs when they are ready."""
        for worker in self._workers:
            if self._queue and not worker.under_way:
                self._give(worker, self._queue.popleft())
        while self._queue and len(self._workers) < self._size:
            process = WorkerProcess(self._work, self._limits.memory_gib)
            worker = _Worker[Task](process, time.monotonic() + START_S)
            self._workers.append(worker)
            self._give(worker, self._queue.popleft())

    def _give(self, worker: _Worker[Task], task: Task) -> None:
        try:
            worker.process.connection.send(task)
        except OSError:  # it has died: another one does the task
            self._queue.appendleft(task)
            return
        worker.under_way = (task,)
        worker.begun += 1
        if worker.ready:
            worker.deadline = time.monotonic() + self._limits.time_s

    def _wait(self) -> None:
        """Wait until a worker has something to say, has ended or has used up its time."""
        handles = [
            handle
            for worker in self._workers
            for handle in (worker.process.connection, worker.process.sentinel)
        ]
        first = min(worker.deadline for worker in self._workers)
        connection.wait(handles, max(0.0, min(first - time.monotonic(), LONGEST_WAIT_S)))

    def _look_at(self, worker: _Worker[Task]) -> None:
        """Take a worker's answer where it has one, even after the deadline, or see to its end."""
        process = worker.process
        try:
            if process.connection.poll():
                self._take(worker, *process.connection.recv())
            elif process.has_ended:
                self._lose(worker, self._exit_reason(process))
            elif time.monotonic() > worker.deadline:
                process.stop()
                limit_s = self._limits.time_s if worker.ready else START_S
                self._lose(worker, WorkerFailure("timeout", f"no result within {limit_s:g} s"))
        except (EOFError, OSError):
            self._lose(worker, self._exit_reason(process))

    def _take(self, worker: _Worker[Task], fine: bool, value: Any) -> None:
        if not worker.ready:  # it says that it is, and goes on with its first task
            worker.ready, worker.deadline = True, time.monotonic() + self._limits.time_s
            return
        self._breaks = 0
        self._ended.append((worker.under_way[0], fine, value))
        worker.under_way, worker.deadline = (), float("inf")
        if worker.begun >= self._tasks_per_worker:
            self._let_go(worker)

    def _lose(self, worker: _Worker[Task], reason: WorkerFailure) -> None:
        """Go on without a worker that has ended or is stopped."""
        self._remove(worker)
        worker.process.join()
        if not worker.ready:
            self._queue.extendleft(worker.under_way)
            self._breaks += 1
            if self._breaks > MOST_BREAKS:
                raise BrokenProcessPool(
                    f"{self._breaks} workers were lost before they could begin ({reason.reason})"
                )
        elif worker.under_way:
            self._breaks = 0
            self._ended.append((worker.under_way[0], True, reason))

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
            return WorkerFailure(
                "memory", f"the worker used more than {self._limits.memory_gib:g} GiB"
            )
        try:
            ending = signal.Signals(-code).name if code < 0 else f"exit code {code}"
        except ValueError:
            ending = f"signal {-code}"
        return WorkerFailure("crash", f"the worker died ({ending})")

    def close(self) -> None:
        """Stop all workers at once; idle workers end by themselves."""
        for worker in tuple(self._workers):
            if not worker.under_way:
                self._let_go(worker)
            else:
                worker.process.stop()
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

    Closing the iterator stops all workers at once. Tasks are taken from their iterable as workers
    get free.
    """
    with closing(TaskPool(work, workers, limits, environment, tasks_per_worker)) as pool:
        yield from submit_all(tasks, pool)


@contextmanager
def _environment(changes: Mapping[str, str]) -> Iterator[None]:
    before = {name: os.environ.get(name) for name in changes}
    os.environ.update(changes)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
