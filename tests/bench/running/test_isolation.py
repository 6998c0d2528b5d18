from __future__ import annotations

import mmap
import os
import re
import signal
import subprocess
import sys
import time
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing
from itertools import count, islice
from pathlib import Path

import numpy as np
import psutil
import pytest

import bench.running.isolation
from bench.catalogue.suites import Limits
from bench.running.isolation import MOST_BREAKS, Lost, TaskPool, run_tasks

pytestmark = pytest.mark.timing

LIMITS = Limits(time_s=60.0, memory_gib=8.0)
ROOT = Path(__file__).parents[3]


AT_ONCE = {  # ways to 16 GiB in one call
    "array": lambda: np.ones(2**31),
    "mapping": lambda: mmap.mmap(-1, 2**34, mmap.MAP_PRIVATE).write(bytes(1)),
    "child": lambda: subprocess.run(
        [sys.executable, "-c", "bytearray(2**34)"], check=True, capture_output=True
    ),
}


def square(x: int) -> int:
    return x * x


def chatter(text: str) -> int:
    print(text, flush=True)
    return os.write(1, text.encode())


def test_what_a_task_prints_is_no_result(capfd) -> None:
    assert dict(run_tasks(["hello"], chatter, 1, LIMITS)) == {"hello": 5}
    assert capfd.readouterr() == ("", "hello\nhello")


def misbehave(task: tuple[str, Path]) -> str:
    """With a folder where it leaves its process."""
    how, folder = task
    (folder / how).write_text(str(os.getpid()))
    if how == "segfault":
        os.kill(os.getpid(), signal.SIGSEGV)
    if how == "exit":
        os._exit(3)
    if how == "hang":
        time.sleep(600)
    if how == "hog":
        kept = []
        while True:
            kept.append(np.ones(2**23))  # 64 MiB, touched
    if how in AT_ONCE:  # faster than the watch looks
        try:
            AT_ONCE[how]()
        except (MemoryError, OSError, subprocess.CalledProcessError) as error:
            if how == "child":
                return error.stderr.split()[-1].decode()
            # not of getrusage, which counts the process that this one was forked from
            held = re.search(r"VmHWM:\s+(\d+) kB", Path("/proc/self/status").read_text())
            return f"{type(error).__name__} at {int(held[1]) / 2**20:.0f} GiB"
    if how == "raise":
        raise KeyError(how)
    return how


@pytest.mark.slow
def test_whatever_becomes_of_a_worker_is_reported_and_the_others_go_on(tmp_path):
    tasks = ["a", "segfault", "b", "hang", "exit", "hog", "c"]
    limits = Limits(time_s=10.0, memory_gib=0.75)
    done = run_tasks([(how, tmp_path) for how in tasks], misbehave, 2, limits)
    found = {how: result for (how, _), result in done}
    assert found == {
        "a": "a",
        "b": "b",
        "c": "c",
        "segfault": Lost("crash", "the worker died (SIGSEGV)"),
        "exit": Lost("crash", "the worker died (exit code 3)"),
        "hang": Lost("timeout", "no result within 10 s"),
        "hog": Lost("memory", "the worker used more than 0.75 GiB"),
    }
    assert found["hang"].reason == "timeout: no result within 10 s"
    assert not psutil.pid_exists(int((tmp_path / "hang").read_text()))


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="the kernel's limit is Linux's")
def test_what_is_asked_for_at_once_beyond_the_limit_is_refused(tmp_path):
    limits = Limits(time_s=60.0, memory_gib=2.0)
    tasks = [(how, tmp_path) for how in (*AT_ONCE, "a")]
    found = {how: result for (how, _), result in run_tasks(tasks, misbehave, 1, limits)}
    assert found == {
        "array": "MemoryError at 0 GiB",
        "mapping": "OSError at 0 GiB",
        "child": "MemoryError",
        "a": "a",
    }


def test_a_pool_may_break_as_often_as_allowed_each_time_before_a_task_ends():
    """As Pebble's does where a worker dies before its task is known to have begun."""
    found, rounds = [], (range(MOST_BREAKS), range(10, 10 + MOST_BREAKS))
    with closing(TaskPool(abs, 1, LIMITS)) as pool:
        for tasks in rounds:
            for x in tasks:
                before = pool._pool
                pool.submit(x)  # which the pool that broke refuses
                assert (pool._pool is before) == (x == tasks[0])
                broken = pool._pool
                broken._pool_manager.handle_broken_pool(BrokenProcessPool("All workers expired"))
            ended = []
            while len(ended) < len(tasks):
                ended += pool.collect()
            assert pool._pool is not broken
            found.append(sorted(ended))
        assert list(pool.collect()) == []  # nothing is left to wait for
    assert found == [[(x, x) for x in tasks] for tasks in rounds]


@pytest.mark.slow
def test_tasks_that_a_pool_has_lost_are_done_again(monkeypatch):
    monkeypatch.setattr(bench.running.isolation, "PATIENCE_S", 0.0)
    with closing(TaskPool(square, 1, Limits(time_s=2.0, memory_gib=8.0))) as pool:
        pool._pool._pool_manager.task_manager.register = lambda task: None
        pool.submit(7)
        assert list(pool.collect()) == [(7, 49)]


@pytest.mark.slow
def test_a_pool_that_always_breaks_is_given_up(monkeypatch):
    def breaks(manager):
        raise BrokenProcessPool("no worker can be started")

    with closing(TaskPool(square, 1, LIMITS)) as pool:
        monkeypatch.setattr(type(pool._pool._pool_manager), "update_status", breaks)
        pool.submit(1)
        with pytest.raises(BrokenProcessPool, match="4 times all workers were lost"):
            list(pool.collect())


def test_what_a_task_raises_is_raised(tmp_path):
    with pytest.raises(KeyError, match="raise"):
        list(run_tasks([("raise", tmp_path)], misbehave, 1, LIMITS))


REPLACING = """
import bench.running.isolation
from bench.running.isolation import Limits, run_tasks
from data_prep.render import gl_renderer
def draw(_):
    return bool(gl_renderer())
if __name__ == "__main__":
    bench.running.isolation.TASKS_PER_WORKER = 1  # at the end, another worker is just starting
    print(len(list(run_tasks(range(3), draw, 2, Limits(60.0, 4.0)))))
"""


@pytest.mark.slow
def test_workers_come_and_go_without_a_word(tmp_path):
    (tmp_path / "replacing.py").write_text(REPLACING)
    command = [sys.executable, str(tmp_path / "replacing.py")]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("3\n", "")


def test_tasks_come_with_their_results_and_are_taken_as_workers_get_free():
    assert dict(run_tasks(range(6), square, 2, LIMITS)) == {x: x * x for x in range(6)}
    taken = []

    def endless():
        for number in count():
            taken.append(number)
            yield number

    with closing(run_tasks(endless(), square, 1, LIMITS)) as stream:
        assert len(list(islice(stream, 5))) == 5
    assert len(taken) <= 5 + 2


INTERRUPTED = """
import threading
import pebble
from bench.running.isolation import Limits, run_tasks

def half(x):
    return x / 2

def leave_a_waiter_behind(queue):
    # `Condition.notify`, interrupted after it has woken a thread and before it has crossed it out.
    stale = threading.Lock()
    stale.acquire()
    queue.not_empty._waiters.appendleft(stale)

pools = []
class Pool(pebble.ProcessPool):
    def __init__(self, *args, **options):
        super().__init__(*args, **options)
        pools.append(self)

if __name__ == "__main__":
    pebble.ProcessPool = Pool
    results = run_tasks(range(100), half, 1, Limits(time_s=60.0, memory_gib=8.0))
    next(results)  # of whichever is done first
    print("running")
    queue = pools[0]._context.task_queue
    while not queue.not_empty._waiters:  # the pool's thread has taken all there is
        pass
    with queue.mutex:
        leave_a_waiter_behind(queue)
    results.close()
    print("closed")
"""


def test_an_interrupt_within_a_notification_does_not_keep_the_pool_from_ending(tmp_path):
    script = tmp_path / "interrupted.py"
    script.write_text(INTERRUPTED)
    done = subprocess.run(
        [sys.executable, script], cwd=ROOT, env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert (done.stdout, done.stderr) == ("running\nclosed\n", "")
