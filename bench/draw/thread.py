"""The one thread in which a process draws, whichever of its threads asks for it.

Two draws at a time would end the process, so they are done one after the other. A process that is
forked later starts a thread of its own: it would wait for ever for threads of PyTorch, which are
not forked with it.
"""

from __future__ import annotations

import atexit
import os
import threading
from collections.abc import Callable
from concurrent.futures import Future
from queue import SimpleQueue
from typing import Any, TypeVar

import data_prep.rendering.opengl  # noqa: F401  it registers its end before `_finish`

Result = TypeVar("Result")


class _Drawer(threading.Thread):
    """The thread, which does what it finds in its queue.

    It is a daemon, for it may not end before the process: MeshLab uses Qt, and what Qt has made in
    a thread is freed twice if that thread ends first.
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
            del future, work  # and the images


_drawer: _Drawer | None = None
_starting, _pools = threading.Lock(), threading.Lock()


def _after_fork() -> None:
    """Forget the thread, and who has the locks: they are not in this process."""
    global _drawer, _starting, _pools
    _drawer = None
    _starting, _pools = threading.Lock(), threading.Lock()


os.register_at_fork(after_in_child=_after_fork)


def on_drawing_thread(work: Callable[[], Result]) -> Result:
    """Return what `work` returns, and raise what it raises, in its turn.

    A KeyboardInterrupt ends the waiting: work that is under way goes on, other work is given up.
    """
    global _drawer
    with _starting:
        if _drawer is None:
            _drawer = _Drawer()
            _drawer.start()
    if threading.current_thread() is _drawer:  # a method that draws by another one
        return work()
    future: Future[Result] = Future()
    _drawer.queue.put((future, work))
    try:
        return future.result()
    finally:
        future.cancel()


@atexit.register
def _finish() -> None:
    """Let the thread do nothing more: what it draws with is about to be freed."""
    if _drawer is not None:
        idle = threading.Event()

        def wait_for_ever() -> None:
            idle.set()
            threading.Event().wait()

        _drawer.queue.put((Future(), wait_for_ever))
        idle.wait()


def one_pool() -> threading.Lock:
    """Return the lock of worker processes, which get their environment by way of this one's."""
    return _pools
