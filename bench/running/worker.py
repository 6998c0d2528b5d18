"""Worker processes that end together with every process they have started, whatever ends them.

A worker is two processes. The pool starts the keeper, which waits and does nothing else, so that it
neither hangs nor crashes; its child, the worker proper, does the tasks. Linux hands a process whose
parent has ended to the nearest subreaper above it: to the worker, and after the worker's end to the
keeper, which ends it. When the pool's process ends, even by SIGKILL, the kernel sends the keeper a
signal. Two cases are not covered: processes of another user (setuid programs) cannot be ended, and
none is where somebody kills the keeper itself by SIGKILL.
"""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import pickle
import resource
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection
from multiprocessing.reduction import ForkingPickler
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import psutil

_WATCH_EVERY_S = 0.1  # seconds between two looks at the memory of the workers
# Writable memory, in GiB, that a worker may reserve beyond its limit on resident memory; then the
# kernel refuses more, because 16 GiB asked for at once would be taken before the watch sees them.
# On the CPU methods reserve at most 0.1 GiB more than they use; the rest is for what CUDA and
# plug-ins reserve.
_RESERVED_GIB = 8.0
PATIENCE_S = 10.0  # seconds until a worker is ended that should have ended by itself
TICK_S = 1.0  # the most seconds between two looks of a pool at its workers
# The most seconds between two looks while the process runs. Where there are more, it was stopped,
# or the machine slept.
_LONGEST_TICK_S = 2.0
NO_GUARD = 78  # the exit code of a worker whose script starts workers when it is loaded
SAFE_PATH = "PYTHONSAFEPATH"  # the variable that keeps the current folder off the path of imports

# Options of the system call prctl, from linux/prctl.h.
PR_SET_PDEATHSIG = 1  # the signal that this process gets when its parent ends
PR_SET_CHILD_SUBREAPER = 36  # whether this process becomes the parent of orphans below it


def own_python(*arguments: str) -> list[str]:
    """Return the command line that runs this Python interpreter with some arguments."""
    # "-P" keeps the current folder off the path of imports, which may hold a `random.py`, say.
    return [sys.executable, "-P", *arguments]


class RunningTime:
    """A clock that stands still while this process is stopped.

    It has to be read every `TICK_S`. Of the time between two readings at most `_LONGEST_TICK_S`
    counts, because a longer pause means a closed lid, SIGSTOP or a frozen container.
    """

    def __init__(self) -> None:
        self._seconds, self._last = 0.0, time.monotonic()

    def __call__(self) -> float:
        """Return the seconds that this process could run since the clock was made."""
        before, self._last = self._last, time.monotonic()
        self._seconds += min(self._last - before, _LONGEST_TICK_S)
        return self._seconds


class WorkerProcess:
    """A process that applies a function to the tasks that it is sent.

    It gets the environment that this process has when it is made. It sends its answers through
    `connection`: (True, None) when it is ready, then (True, value) or (False, exception) for each
    task. `stop` ends it, and so do `let_go` and `join`, with all processes that it has started.
    """

    def __init__(self, work: Callable[[Any], Any], memory_gib: float) -> None:
        if getattr(multiprocessing.current_process(), "_inheriting", False):
            # This process is itself a new worker, which loads the script that starts workers.
            os._exit(NO_GUARD)
        spawn = multiprocessing.get_context("spawn")
        self.connection, of_worker = spawn.Pipe()
        self._keeper = spawn.Process(target=_keep, args=(of_worker, memory_gib))
        self._keeper.start()
        self.pid: int = self._keeper.pid or 0  # the process id of the keeper
        # A handle for `multiprocessing.connection.wait`, ready when the keeper has ended.
        self.sentinel = self._keeper.sentinel
        of_worker.close()
        # As an argument of the process the keeper would load it, too, with all that it imports.
        self.send(work)

    def send(self, value: object) -> None:
        """Send the function or a task, without waiting: a worker that hangs reads nothing."""
        data, sent = ForkingPickler.dumps(value), threading.Event()

        def write() -> None:
            # The connection is closed where the worker has ended or was let go meanwhile.
            with suppress(OSError, TypeError):
                self.connection.send_bytes(data)
                sent.set()

        self._sent = sent
        self._sender = threading.Thread(target=write, name="task", daemon=True)
        self._sender.start()

    def was_reached(self) -> bool:
        """Return whether all that was sent last has reached a worker that has ended."""
        self._sender.join(PATIENCE_S)
        return self._sent.is_set()

    @property
    def has_ended(self) -> bool:
        """Return whether the keeper, the last of the processes, has ended."""
        return self._keeper.exitcode is not None

    def exit_code(self) -> int:
        """Wait until all processes have ended, and return their exit code.

        As in `multiprocessing` it is negative where a signal has ended the worker.
        """
        self.join()
        return self._keeper.exitcode or 0

    def let_go(self) -> None:
        """Let an idle worker end by itself."""
        self.connection.close()

    def stop(self) -> None:
        """Tell the keeper to end all processes, without waiting until they have ended."""
        self._keeper.terminate()

    def join(self) -> None:
        """Wait until all processes have ended; after `PATIENCE_S` end those that are left."""
        self._keeper.join(PATIENCE_S)  # in vain where a library hangs when it is unloaded
        if not self.has_ended:
            self.stop()
            self._keeper.join(PATIENCE_S)
        if not self.has_ended:
            self._keeper.kill()
            self._keeper.join()


def _keep(connection: Connection, memory_gib: float) -> None:
    """Run a worker as a child; when it ends, or on SIGTERM, end all of its processes.

    This process then ends as the worker did: by the same signal or with the same exit code.
    """
    os.setsid()  # a session of its own, which Ctrl-C and Ctrl-Z of the terminal do not reach
    _control(PR_SET_PDEATHSIG, signal.SIGTERM)
    pool = multiprocessing.parent_process()
    if pool is None or os.getppid() != pool.pid:  # the pool ended before the kernel was asked
        return
    _control(PR_SET_CHILD_SUBREAPER, 1)
    expected = (signal.SIGTERM, signal.SIGCHLD)
    signal.pthread_sigmask(signal.SIG_BLOCK, expected)
    worker = os.fork()
    if worker == 0:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, expected)
        _serve(connection, memory_gib)
        return
    connection.close()  # as long as it is open here, the pool does not see the worker's end
    ended, status = 0, signal.SIGTERM.value
    while not ended and signal.sigwait(expected) != signal.SIGTERM:
        ended, status = os.waitpid(worker, os.WNOHANG)
    _end_children()
    _end_like(os.waitstatus_to_exitcode(status if ended else signal.SIGTERM.value))


def _end_like(code: int) -> None:
    """End this process at once, with an exit code, or by a signal where the code is negative."""
    if code < 0:
        _, most = resource.getrlimit(resource.RLIMIT_CORE)
        # No core dump of the keeper: the worker has left its own, where dumps are wanted.
        resource.setrlimit(resource.RLIMIT_CORE, (0, most))
        with suppress(OSError):  # SIGKILL has no handler
            signal.signal(-code, signal.SIG_DFL)
        signal.pthread_sigmask(signal.SIG_SETMASK, ())
        os.kill(os.getpid(), -code)
    os._exit(code)


def _serve(connection: Connection, memory_gib: float) -> None:
    """Do one task after another, until the pool closes its end of the connection."""
    _bind(memory_gib)
    os.environ.pop(SAFE_PATH, None)  # so that a Python that a method starts imports as usual
    worker = os.getpid()
    with suppress(EOFError, BrokenPipeError, ConnectionResetError):  # raised where the pool ends
        work = connection.recv()
        connection.send((True, None))
        while True:
            answer = _answer(work, connection.recv())
            if os.getpid() != worker:
                # This is a child that the task has forked and not ended. The worker itself answers.
                os._exit(0)
            _end_children()  # so that they do not count for the next task's time and memory
            try:
                connection.send(answer)
            except (pickle.PicklingError, TypeError, AttributeError) as error:
                connection.send((False, error))


def _answer(work: Callable[[Any], Any], task: object) -> tuple[bool, Any]:
    """Return True and the result of a task, or False and its exception."""
    try:
        return True, work(task)
    except BaseException as error:
        error.add_note(f"in a worker:\n{traceback.format_exc()}")
        return False, error


def _bind(memory_gib: float) -> None:
    """Tie this process to its keeper, and have the kernel limit its memory.

    Beyond the limit an allocation fails, which Python raises as MemoryError.
    """
    os.dup2(2, 1)  # what a method prints goes to stderr, since stdout is for a command's results
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _control(PR_SET_PDEATHSIG, signal.SIGKILL)
    _control(PR_SET_CHILD_SUBREAPER, 1)
    _, most = resource.getrlimit(resource.RLIMIT_DATA)
    limit = int((memory_gib + _RESERVED_GIB) * 2**30)
    if most != resource.RLIM_INFINITY:
        limit = min(limit, most)
    resource.setrlimit(resource.RLIMIT_DATA, (limit, most))


def _control(option: int, value: int) -> None:
    """Set an option of this process by the system call prctl, which Python does not have."""
    ctypes.CDLL(None).prctl(option, value)


def _end_children() -> None:
    """End all children of this process, and their children."""
    with suppress(ChildProcessError):  # raised when no child is left
        # Children of children become children of this process when their parents end.
        while True:
            while os.waitpid(-1, os.WNOHANG)[0]:
                pass
            import psutil

            for child in psutil.Process().children():
                with suppress(psutil.Error):
                    child.kill()
            time.sleep(0.005)


@contextmanager
def watched_memory(keepers: Callable[[], Iterable[int]], limit_gib: float) -> Iterator[set[int]]:
    """Kill workers that exceed the limit, with all their processes, as long as the block lasts.

    keepers    returns the process ids of the workers' keepers
    limit_gib  the most resident memory of one worker and its processes together

    Yields the set of the keepers whose workers were killed. The limit of the kernel (`_bind`) is
    not enough: a library whose allocation fails does anything from raising an exception to giving a
    wrong result.
    """
    import psutil

    # The watch is in the pool's process, since a worker that hangs or allocates in a native library
    # runs no Python thread.
    killed: set[int] = set()
    stop = threading.Event()

    def watch() -> None:
        while not stop.wait(_WATCH_EVERY_S):
            for keeper, family in _families(keepers()).items():
                if _exceeds(family, limit_gib * 2**30):
                    killed.add(keeper)
                    for process in family:
                        with suppress(psutil.Error):  # raised for a process that has ended
                            process.kill()

    watcher = threading.Thread(target=watch, name="memory watch", daemon=True)
    watcher.start()
    try:
        yield killed
    finally:
        stop.set()
        watcher.join()


def _families(keepers: Iterable[int]) -> dict[int, list[psutil.Process]]:
    """Return all processes below each keeper, by reading the process table once."""
    import psutil

    keeper_of = {keeper: keeper for keeper in keepers}
    families: dict[int, list[psutil.Process]] = {keeper: [] for keeper in keeper_of}
    if families:
        # They come with parents before their children, so that a parent's keeper is known.
        for process in psutil.Process().children(recursive=True):
            with suppress(psutil.Error):
                keeper = keeper_of.get(process.ppid())
                if keeper is not None:
                    keeper_of[process.pid] = keeper
                    families[keeper].append(process)
    return families


def _exceeds(family: list[psutil.Process], limit: float) -> bool:
    """Return whether processes together hold more bytes of memory than the limit."""
    import psutil

    def total(size: Callable[[psutil.Process], int]) -> int:
        held = 0
        for process in family:
            with suppress(psutil.Error):  # raised for a process that has ended
                held += size(process)
        return held

    resident = total(lambda process: process.memory_info().rss)
    if resident <= limit or len(family) == 1:
        return resident > limit
    # This sum counts the pages that forked processes share once for each process. The proportional
    # set size (PSS) counts them once. It is not looked at each time, since the kernel walks all
    # page tables for it, which is slow.
    return total(lambda process: process.memory_full_info().pss) > limit
