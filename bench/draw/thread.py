"""The one thread in which a process draws, whichever of its threads asks for it.

Drawing in two threads at the same time would crash the process, so that images are drawn one after
the other. A forked process starts a drawing thread of its own: threads do not exist in a fork, and
waiting for one of the old process, or of its PyTorch, would never end.
"""

from __future__ import annotations

import atexit
import os
import threading
from collections.abc import Callable
from concurrent.futures import Future
from queue import SimpleQueue
from typing import Any, TypeVar

import data_prep.rendering.opengl  # noqa: F401  its exit handler is to be registered first, to run after `_finish`

Result = TypeVar("Result")


class _Drawer(threading.Thread):
    """The drawing thread, which does the work that it finds in its queue.

    It is a daemon thread, as it must not end before the process: MeshLab uses Qt, which would free
    what it has made in the thread a second time.
    """

    def __init__(self) -> None:
        super().__init__(name="draw", daemon=True)
        self.queue: SimpleQueue[tuple[Future[Any], Callable[[], Any]]] = SimpleQueue()

    def run(self) -> None:
        while True:
            future, work = self.queue.get()
            if future.set_running_or_notify_cancel():
                try:
                    future.set_result(work())
                except BaseException as error:
                    future.set_exception(error)
            del future, work  # frees the images while the thread waits for more work


_drawer: _Drawer | None = None
_starting, _pools = threading.Lock(), threading.Lock()


def _after_fork() -> None:
    """Forget the thread and the locks of the parent process, which do not work in the fork."""
    global _drawer, _starting, _pools
    _drawer = None
    _starting, _pools = threading.Lock(), threading.Lock()


os.register_at_fork(after_in_child=_after_fork)


def on_drawing_thread(work: Callable[[], Result]) -> Result:
    """Do `work` on the drawing thread, after earlier work; return or raise what it does.

    A KeyboardInterrupt ends the waiting. Work that has begun then goes on in the thread; work that
    has not begun is given up.
    """
    global _drawer
    with _starting:
        if _drawer is None:
            _drawer = _Drawer()
            _drawer.start()
    if threading.current_thread() is _drawer:  # one method draws with another one
        return work()
    future: Future[Result] = Future()
    _drawer.queue.put((future, work))
    try:
        return future.result()
    finally:
        future.cancel()


@atexit.register
def _finish() -> None:
    """Stop the thread from drawing, as the process is about to free what it draws with."""
    if _drawer is not None:
        idle = threading.Event()

        def wait_for_ever() -> None:
            idle.set()
            threading.Event().wait()

        _drawer.queue.put((Future(), wait_for_ever))
        idle.wait()


def one_pool() -> threading.Lock:
    """Return the lock for starting worker processes.

    They inherit their environment variables from this process, which sets them for that moment, so
    that two threads may not start workers at once.
    """
    return _pools
