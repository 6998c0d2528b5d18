"""Worker processes that end together with every process they have started, whatever ends them.

A worker is two processes. The pool starts the keeper, which waits and does nothing else, so that it
neither hangs nor crashes; its child, the worker proper, does the tasks. Linux hands orphans to the
nearest subreaper above them: first the worker, after its end the keeper, which ends them. The
kernel tells the keeper of the pool's end, even by SIGKILL. Two things escape: processes of another
user (setuid programs), and all of them where somebody kills the keeper itself by SIGKILL.
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

_WATCH_EVERY_S = 0.1
# Beyond the limit on resident memory the kernel refuses writable memory: 16 GiB asked for at once
# are faster than the watch. On the CPU methods reserve at most 0.1 GiB more than they use; the rest
# is for what CUDA and plug-ins reserve.
_RESERVED_GIB = 8.0
PATIENCE_S = 10.0  # with a worker that has nothing left to do, or ought to have ended
TICK_S = 1.0  # a pool looks about so often
_LONGEST_TICK_S = 2.0  # of a process that runs; a longer one was stopped, or the machine slept
NO_GUARD = 78  # exit code of a worker whose script starts workers when it is loaded
SAFE_PATH = "PYTHONSAFEPATH"  # keeps the current folder off the path of imports

PR_SET_PDEATHSIG, PR_SET_CHILD_SUBREAPER = 1, 36  # linux/prctl.h


def own_python(*arguments: str) -> list[str]:
    """Return the command of another process of this interpreter."""
    return [sys.executable, "-P", *arguments]  # a `random.py` in this folder is not ours to run


class RunningTime:
    """A clock, read every `TICK_S`, that stands still while this process is stopped.

    What lies beyond `_LONGEST_TICK_S` between two readings counts for nothing: a closed lid,
    SIGSTOP, a frozen container.
    """

    def __init__(self) -> None:
        self._seconds, self._last = 0.0, time.monotonic()

    def __call__(self) -> float:
        """Return the seconds that this process could run since the clock was made."""
        before, self._last = self._last, time.monotonic()
        self._seconds += min(self._last - before, _LONGEST_TICK_S)
        return self._seconds


class WorkerProcess:
    """A process that applies a function to the tasks it is sent, with all that it has started.

    It reads its environment when it starts. The answers, which `connection` gives in turn, are
    (True, None) when it is ready, then (True, value) or (False, exception) for each task. End it by
    `stop`, or by `let_go` and `join`.
    """

    def __init__(self, work: Callable[[Any], Any], memory_gib: float) -> None:
        if getattr(multiprocessing.current_process(), "_inheriting", False):
            os._exit(NO_GUARD)  # a new worker, which is still loading the script that wants workers
        spawn = multiprocessing.get_context("spawn")
        self.connection, of_worker = spawn.Pipe()
        self._keeper = spawn.Process(target=_keep, args=(of_worker, memory_gib))
        self._keeper.start()
        self.pid: int = self._keeper.pid or 0  # of the keeper
        self.sentinel = self._keeper.sentinel  # is ready when the keeper has ended
        of_worker.close()
        self.send(work)  # not as an argument: the keeper need not load its module

    def send(self, value: object) -> None:
        """Send the function or a task. Nobody waits: a worker may hang, and read nothing."""
        data, sent = ForkingPickler.dumps(value), threading.Event()

        def write() -> None:
            with suppress(OSError, TypeError):  # it has ended, or was let go: closed meanwhile
                self.connection.send_bytes(data)
                sent.set()

        self._sent = sent
        self._sender = threading.Thread(target=write, name="task", daemon=True)
        self._sender.start()

    def was_reached(self) -> bool:
        """Return whether a worker that has ended got all of what it was sent last."""
        self._sender.join(PATIENCE_S)
        return self._sent.is_set()

    @property
    def has_ended(self) -> bool:
        """Return whether the keeper, the last of the processes, has ended."""
        return self._keeper.exitcode is not None

    def exit_code(self) -> int:
        """Wait until all processes have ended, and return the `multiprocessing` exit code."""
        self.join()
        return self._keeper.exitcode or 0

    def let_go(self) -> None:
        """Let an idle worker end by itself."""
        self.connection.close()

    def stop(self) -> None:
        """End all processes, without waiting for that."""
        self._keeper.terminate()

    def join(self) -> None:
        """Wait until all processes have ended; after `PATIENCE_S` end the others."""
        self._keeper.join(PATIENCE_S)  # a library may hang when it is unloaded
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
    os.setsid()  # no Ctrl-C or Ctrl-Z of the terminal reaches a worker
    _control(PR_SET_PDEATHSIG, signal.SIGTERM)
    pool = multiprocessing.parent_process()
    if pool is None or os.getppid() != pool.pid:  # it ended before the kernel was asked
        return
    _control(PR_SET_CHILD_SUBREAPER, 1)
    expected = (signal.SIGTERM, signal.SIGCHLD)
    signal.pthread_sigmask(signal.SIG_BLOCK, expected)
    worker = os.fork()
    if worker == 0:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, expected)
        _serve(connection, memory_gib)
        return
    connection.close()  # else the pool would not see the worker's end
    ended, status = 0, signal.SIGTERM.value
    while not ended and signal.sigwait(expected) != signal.SIGTERM:
        ended, status = os.waitpid(worker, os.WNOHANG)
    _end_children()
    _end_like(os.waitstatus_to_exitcode(status if ended else signal.SIGTERM.value))


def _end_like(code: int) -> None:
    """End this process at once, with an exit code of `multiprocessing`: negative is a signal."""
    if code < 0:
        _, most = resource.getrlimit(resource.RLIMIT_CORE)
        resource.setrlimit(resource.RLIMIT_CORE, (0, most))  # the worker has left its dump, if any
        with suppress(OSError):  # SIGKILL has no handler
            signal.signal(-code, signal.SIG_DFL)
        signal.pthread_sigmask(signal.SIG_SETMASK, ())
        os.kill(os.getpid(), -code)
    os._exit(code)


def _serve(connection: Connection, memory_gib: float) -> None:
    """Do one task after another, until the pool closes its end of the connection."""
    _bind(memory_gib)
    os.environ.pop(SAFE_PATH, None)  # a method that starts Python gets it as usual
    worker = os.getpid()
    with suppress(EOFError, BrokenPipeError, ConnectionResetError):  # the pool is gone
        work = connection.recv()
        connection.send((True, None))
        while True:
            answer = _answer(work, connection.recv())
            if os.getpid() != worker:
                os._exit(0)  # a task forked, and its child came back, too: one answer is enough
            _end_children()  # a task's result and memory depend on no other task
            try:
                connection.send(answer)
            except (pickle.PicklingError, TypeError, AttributeError) as error:
                connection.send((False, error))


def _answer(work: Callable[[Any], Any], task: object) -> tuple[bool, Any]:
    try:
        return True, work(task)
    except BaseException as error:
        error.add_note(f"in a worker:\n{traceback.format_exc()}")
        return False, error


def _bind(memory_gib: float) -> None:
    """Tie this process to its keeper, and have the kernel bound its memory (MemoryError)."""
    os.dup2(2, 1)  # stdout is for the results of a command: what a method prints goes to stderr
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _control(PR_SET_PDEATHSIG, signal.SIGKILL)
    _control(PR_SET_CHILD_SUBREAPER, 1)
    _, most = resource.getrlimit(resource.RLIMIT_DATA)
    wanted = int((memory_gib + _RESERVED_GIB) * 2**30)
    least = wanted if most == resource.RLIM_INFINITY else min(wanted, most)
    resource.setrlimit(resource.RLIMIT_DATA, (least, most))


def _control(option: int, value: int) -> None:
    ctypes.CDLL(None).prctl(option, value)


def _end_children() -> None:
    """End all children of this process, and their children."""
    with suppress(ChildProcessError):  # none is left
        while True:  # children of children come up to this process as their parents end
            while os.waitpid(-1, os.WNOHANG)[0]:
                pass
            import psutil

            for child in psutil.Process().children():
                with suppress(psutil.Error):
                    child.kill()
            time.sleep(0.005)


@contextmanager
def watched_memory(keepers: Callable[[], Iterable[int]], limit_gib: float) -> Iterator[set[int]]:
    """Kill workers that outgrow the limit, with all their processes, as long as the block lasts.

    `keepers` returns the process ids of the workers' keepers; those whose workers were killed are
    yielded as a set. The limit is the resident memory of one worker and its processes together.
    RLIMIT_DATA alone (`_bind`) is not enough: a library whose allocation fails does anything from
    raising an exception to giving a wrong result.
    """
    import psutil

    # From outside: code that hangs in a native library, or allocates there, runs no Python thread.
    killed: set[int] = set()
    stop = threading.Event()

    def watch() -> None:
        while not stop.wait(_WATCH_EVERY_S):
            for keeper, family in _families(keepers()).items():
                if _exceeds(family, limit_gib * 2**30):
                    killed.add(keeper)
                    for process in family:
                        with suppress(psutil.Error):  # gone meanwhile
                            process.kill()

    watcher = threading.Thread(target=watch, name="memory watch", daemon=True)
    watcher.start()
    try:
        yield killed
    finally:
        stop.set()
        watcher.join()


def _families(keepers: Iterable[int]) -> dict[int, list[psutil.Process]]:
    """Return all processes below each keeper, by one look at the process table."""
    import psutil

    keeper_of = {keeper: keeper for keeper in keepers}
    families: dict[int, list[psutil.Process]] = {keeper: [] for keeper in keeper_of}
    if families:
        for process in psutil.Process().children(recursive=True):  # parents before their children
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
            with suppress(psutil.Error):  # gone meanwhile
                held += size(process)
        return held

    resident = total(lambda process: process.memory_info().rss)
    if resident <= limit or len(family) == 1:
        return resident > limit
    # The sum counts pages that forked processes share once for each; to count them once (PSS) the
    # kernel walks all page tables, too slow for every look.
    return total(lambda process: process.memory_full_info().pss) > limit
