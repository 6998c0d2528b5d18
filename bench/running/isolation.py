"""Tasks in killable worker processes: spawned, one library thread each, replaced now and then.

Native libraries hang, leak and crash (see CONTRIBUTING.md); a task that does costs its own result
and nothing else. One thread a worker, whatever their number, so that no result depends on how many
neighbours a task had: sums are taken in the same order. Tasks are idempotent, and what becomes of
one depends on nothing but the task: an executor may do one twice, on any machine, in any order.
"""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import resource
import signal
import sys
import threading
import time
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from itertools import islice
from typing import TYPE_CHECKING, Any, Generic, Literal, Protocol, TypeVar

from bench.catalogue.suites import Limits

if TYPE_CHECKING:
    from pebble import ProcessPool


@contextmanager
def one_thread() -> Iterator[None]:
    """Within, this process computes on one thread; afterwards on as many as before."""
    import torch
    from threadpoolctl import threadpool_limits

    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with threadpool_limits(1):
            yield
    finally:
        torch.set_num_threads(before)


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


def feed(
    tasks: Iterable[Task | None], executor: Executor[Task, Done]
) -> Generator[Done, None, None]:
    """What becomes of each task, as it comes; tasks are taken as there is room.

    None among the tasks: the next one waits for the end of one that is under way.
    """
    queue, under_way = iter(tasks), 0
    while True:
        for task in islice(queue, max(0, executor.room - under_way)):
            if task is None:
                break
            executor.submit(task)
            under_way += 1
        if not under_way:
            return
        for done in executor.collect():
            under_way -= 1
            yield done


Result = TypeVar("Result")

TASKS_PER_WORKER = 500  # then a fresh process: what leaks, leaks no further
WATCH_EVERY_S = 0.1
# Beyond the limit on resident memory the kernel refuses writable memory: 16 GiB asked for at once
# are faster than the watch. On the CPU methods reserve at most 0.1 GiB more than they use; the rest
# is for what CUDA and plug-ins reserve.
RESERVED_GIB = 8.0
LOOK_EVERY_S = 1.0  # whether the pool is well, while tasks are waited for
PATIENCE_S = 10.0  # with workers that have nothing left to do, or ought to have ended
MOST_BREAKS = 3  # of a pool, without a task's end in between


def thread_counts(threads: int) -> dict[str, str]:
    """What libraries read from the environment, when they are loaded, to use so many threads."""
    names = (
        *("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS"),
        "LP_NUM_THREADS",  # Mesa's software rasteriser
    )
    return dict.fromkeys(names, str(threads))


WORKER_ENVIRONMENT = thread_counts(1) | {
    # MeshLab's APSS reads memory that it has not written: in about half of all processes some
    # vertices end up a rounding error away, and where the surface is ill-conditioned a spike more
    # or less moves SSIM by 0.05. With glibc filling what it hands out (255 is a fill of zeros)
    # and keeping no cache of freed blocks, every process reads the same.
    "GLIBC_TUNABLES": "glibc.malloc.perturb=255:glibc.malloc.tcache_count=0",
}


@dataclass(frozen=True)
class Lost:
    """A task whose worker had to be killed, or died."""

    kind: Literal["timeout", "memory", "crash"]
    detail: str

    @property
    def reason(self) -> str:
        """For a record: "timeout: no result within 120 s"."""
        return f"{self.kind}: {self.detail}"


class TaskPool(Generic[Task, Result]):
    """Worker processes that do `work(task)`, one task at a time each.

    `work` and the tasks cross process boundaries: a function of a module, and plain values.
    `environment` is put on top of this process's own. To be closed, whatever happens, before
    another is made.

    Pebble takes a worker's death before its task's beginning is known for the end of the whole pool
    (`BrokenProcessPool`), or loses the task (noxdafox/pebble#153). What it has not finished then is
    done by another pool, from the beginning.
    """

    def __init__(
        self,
        work: Callable[[Task], Result],
        workers: int,
        limits: Limits,
        environment: Mapping[str, str] = WORKER_ENVIRONMENT,
    ) -> None:
        from pebble import ProcessPool

        self._work, self._limits = work, limits
        # A short queue: what is scheduled has been pickled; there may be 10^5 tasks.
        self.room = 2 * workers
        self._waiting: dict[Future[Result], Task] = {}
        self._around = ExitStack()
        self._around.enter_context(_environment(environment))  # workers read it when they start
        self._new_pool: Callable[[], ProcessPool] = partial(
            ProcessPool,
            max_workers=workers,
            max_tasks=TASKS_PER_WORKER,
            initializer=_bind_worker,
            initargs=[limits.memory_gib],
            context=multiprocessing.get_context("spawn"),
        )
        self._pool = self._new_pool()
        self._breaks = 0
        self._around.callback(lambda: _stop(self._pool))
        self._over_limit = self._around.enter_context(_watch_memory(limits.memory_gib))

    def submit(self, task: Task) -> None:
        """Have a task done; at most `room` may be under way. Raises BrokenProcessPool, too."""
        try:
            future = self._pool.schedule(self._work, args=[task], timeout=self._limits.time_s)
        except RuntimeError:  # the pool broke meanwhile
            self._start_again()
            self.submit(task)
        else:
            self._waiting[future] = task  # type: ignore[index]

    def collect(self) -> Iterator[tuple[Task, Result | Lost]]:
        """Wait until tasks have ended; each with its result, or with what became of its worker.

        What `work` raises is raised here, and BrokenProcessPool where one pool after another breaks
        before any task has ended: no worker can be started, say.
        """
        from pebble import ProcessExpired

        ended: set[Future[Result]] = set()
        while self._waiting and not ended:
            ended = self._ended()
        for future in ended:
            task = self._waiting.pop(future)
            try:
                result: Result | Lost = future.result()
            except TimeoutError:
                result = Lost("timeout", f"no result within {self._limits.time_s:g} s")
            except ProcessExpired as error:
                result = _exit_reason(error, self._over_limit, self._limits)
            yield task, result

    def _ended(self) -> set[Future[Result]]:
        """Tasks that have ended; none where the pool broke, which another has replaced by then."""
        ended: set[Future[Result]] = set()
        # Of tasks that have begun, one ends within the limit.
        until = time.monotonic() + 2 * self._limits.time_s + PATIENCE_S
        while not ended and self._pool.active and time.monotonic() < until:
            ended = wait(self._waiting, LOOK_EVERY_S, FIRST_COMPLETED).done
        ended = {future for future in ended if not _is_lost(future)}
        if ended:
            self._breaks = 0
        else:
            self._start_again()
        return ended

    def _start_again(self) -> None:
        """Another pool, for what this one has not finished."""
        self._breaks += 1
        if self._breaks > MOST_BREAKS:
            raise BrokenProcessPool(
                f"{self._breaks} times all workers were lost before any task had ended"
            )
        _stop(self._pool)
        self._pool = self._new_pool()
        for future in [future for future in self._waiting if _is_lost(future)]:
            self.submit(self._waiting.pop(future))

    def close(self) -> None:
        """Stop all workers at once; idle ones are let go."""
        if not self._waiting:
            _let_go(self._pool)
        self._around.close()


def run_tasks(
    tasks: Iterable[Task],
    work: Callable[[Task], Result],
    workers: int,
    limits: Limits,
    environment: Mapping[str, str] = WORKER_ENVIRONMENT,
) -> Generator[tuple[Task, Result | Lost], None, None]:
    """Each task with `work(task)`, or with what became of its worker, as they come.

    As `TaskPool`. Closing the iterator stops all workers at once. Tasks are taken from their
    iterable as workers get free.
    """
    with closing(TaskPool(work, workers, limits, environment)) as pool:
        yield from feed(tasks, pool)


def _is_lost(future: Future[Any]) -> bool:
    """Whether nothing is known of a task of a pool that broke or was stopped."""
    return not future.done() or isinstance(future.exception(), BrokenProcessPool)


def _stop(pool: ProcessPool) -> None:
    """Stop all workers at once, and wait until nothing is left of the pool."""
    pool.stop()
    # An interrupt in the middle of `Condition.notify`, while a task is put into the queue, leaves a
    # waiter behind that swallows the next notification: that of the end, which the pool's thread
    # would wait for without end. So there is one more.
    pool._context.task_queue.put(None)  # pyright: ignore[reportPrivateUsage]
    pool.join()


def _let_go(pool: ProcessPool) -> None:
    """Let idle workers end by themselves; one that is just starting would complain if stopped."""
    pool.close()
    with suppress(TimeoutError):  # a library that hangs when it is unloaded
        pool.join(PATIENCE_S)


def _exit_reason(error: object, over_limit: set[int], limits: Limits) -> Lost:
    if getattr(error, "pid", None) in over_limit:
        return Lost("memory", f"the worker used more than {limits.memory_gib:g} GiB")
    code = getattr(error, "exitcode", 0)
    try:
        how = signal.Signals(-code).name if code < 0 else f"exit code {code}"
    except ValueError:
        how = f"signal {-code}"
    return Lost("crash", f"the worker died ({how})")


@contextmanager
def _watch_memory(limit_gib: float) -> Iterator[set[int]]:
    """Kills workers of this process that outgrow the limit; yields the set of their pids.

    From outside: code that hangs in a native library, or allocates there, runs no Python thread.
    Not by RLIMIT_DATA alone (`_bind_worker`): what a library does when an allocation fails is
    anything from an exception to a wrong result.
    """
    import psutil

    killed: set[int] = set()
    stop = threading.Event()

    def watch() -> None:
        while not stop.wait(WATCH_EVERY_S):
            for child in psutil.Process().children():
                try:
                    if "--multiprocessing-fork" not in child.cmdline():
                        continue
                    if child.memory_info().rss > limit_gib * 2**30:
                        killed.add(child.pid)
                        child.kill()
                except psutil.Error:  # gone meanwhile
                    continue

    watcher = threading.Thread(target=watch, name="memory watch", daemon=True)
    watcher.start()
    try:
        yield killed
    finally:
        stop.set()
        watcher.join()


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


def _bind_worker(memory_gib: float) -> None:
    """In a worker (Linux): it ends with the run, and the kernel bounds its memory.

    SIGKILL to the run ends it too, even where native code hangs. What takes more than the limit and
    RESERVED_GIB is refused, whoever asks: a MemoryError in Python.
    """
    os.dup2(2, 1)  # stdout is for the results of a command: what a method prints goes to stderr
    if sys.platform != "linux":
        return
    pr_set_pdeathsig = 1  # linux/prctl.h
    ctypes.CDLL(None).prctl(pr_set_pdeathsig, signal.SIGKILL)
    _, most = resource.getrlimit(resource.RLIMIT_DATA)
    wanted = int((memory_gib + RESERVED_GIB) * 2**30)
    if most != resource.RLIM_INFINITY:
        wanted = min(wanted, most)
    resource.setrlimit(resource.RLIMIT_DATA, (wanted, most))
