from __future__ import annotations

import mmap
import os
import re
import signal
import subprocess
import sys
import time
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, suppress
from itertools import count, islice
from pathlib import Path

import numpy as np
import psutil
import pytest

from bench.catalogue.suites import Limits
from bench.running import pool as pools
from bench.running.pool import TaskPool, WorkerFailure, run_tasks
from bench.running.worker import watched_memory

pytestmark = pytest.mark.timing

LIMITS = Limits(time_s=60.0, memory_gib=8.0)


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
        "segfault": WorkerFailure("crash", "the worker died (SIGSEGV)"),
        "exit": WorkerFailure("crash", "the worker died (exit code 3)"),
        "hang": WorkerFailure("timeout", "no result within 10 s"),
        "hog": WorkerFailure("memory", "the worker used more than 0.75 GiB"),
    }
    assert found["hang"].reason == "timeout: no result within 10 s"
    assert not psutil.pid_exists(int((tmp_path / "hang").read_text()))


def meddle(how: str) -> str:
    if how == "fork":
        os.fork()  # both processes go on
    if how == "garbage":
        for descriptor in range(3, 64):
            with suppress(OSError):
                os.write(descriptor, bytes([0, 0, 0, 3]) + b"abc")
    return how


def test_a_task_that_forks_or_writes_to_its_pool_costs_itself_alone():
    unreadable = WorkerFailure("crash", "no answer that can be read")
    assert dict(run_tasks(["a", "fork", "b", "garbage", "c"], meddle, 1, LIMITS)) == {
        "a": "a",
        "fork": "fork",
        "b": "b",
        "garbage": unreadable,
        "c": "c",
    }


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


class Fatal:
    """A function that ends the process that unpickles it."""

    def __reduce__(self):
        return os._exit, (4,)

    def __call__(self, task):
        return task


def test_workers_that_cannot_begin_are_given_up():
    lost = (
        r"before they could begin, one after the other \(crash: the worker died \(exit code 4\)\)"
    )
    with closing(TaskPool(Fatal(), 1, LIMITS)) as pool:
        pool.submit(1)
        with pytest.raises(BrokenProcessPool, match=lost):
            list(pool.wait_any())


class Sleepy(Fatal):
    """A function that hangs where it is unpickled, before a worker is ready."""

    def __reduce__(self):
        return time.sleep, (600,)


LARGE = bytes(400_000)  # more than a pipe takes


@pytest.mark.parametrize("task", [1, LARGE], ids=["small", "large"])
def test_a_start_that_hangs_is_named_within_its_limit(monkeypatch, task):
    monkeypatch.setattr(pools, "START_S", 1.5)
    start = time.monotonic()
    with closing(TaskPool(Sleepy(), 1, LIMITS)) as pool:
        pool.submit(task)
        with pytest.raises(BrokenProcessPool, match=r"timeout: not ready within 1\.5 s"):
            list(pool.wait_any())
    assert time.monotonic() - start < 30


def test_a_large_task_for_a_worker_that_does_not_read_ends_at_its_limit():
    with closing(TaskPool(tell_pid, 1, Limits(2.0, 8.0))) as pool:
        pool.submit(1)
        ((_, worker),) = pool.wait_any()
        os.kill(worker, signal.SIGSTOP)
        pool.submit(LARGE)
        ((_, result),) = pool.wait_any()
        assert result == WorkerFailure("timeout", "no result within 2 s")


STOPPED = """
import sys, time
from bench.running.pool import Limits, run_tasks
def nap(seconds):
    print("begun", file=sys.stderr, flush=True)
    time.sleep(seconds)
if __name__ == "__main__":
    print(list(run_tasks([2.0], nap, 1, Limits(6.0, 8.0))))
"""


@pytest.mark.slow
def test_a_task_does_not_pay_for_the_time_in_which_everything_stood_still(tmp_path):
    (tmp_path / "stopped.py").write_text(STOPPED)
    command = [sys.executable, tmp_path / "stopped.py"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stderr.readline() == b"begun\n"
        pool = psutil.Process(process.pid)
        family = [*pool.children(recursive=True)]
        for member in (pool, *family):
            member.suspend()
        time.sleep(7.0)
        pool.resume()
        time.sleep(1.0)  # it looks at the time before its workers go on
        for member in family:
            member.resume()
        out, _ = process.communicate()
    assert out == b"[(2.0, None)]\n"


KEEPER = "import subprocess, sys; subprocess.run([sys.executable, '-c', sys.argv[1]])"
HELD_OPEN = "import sys; held = bytearray({}); print('held', flush=True); sys.stdin.read()"


def keeper_of(bytes_held: int) -> subprocess.Popen[bytes]:
    """Start a process whose only child holds so much until stdin ends."""
    command = [sys.executable, "-c", KEEPER, HELD_OPEN.format(bytes_held)]
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)


def test_the_watch_kills_the_worker_that_outgrows_the_limit_and_no_other() -> None:
    with keeper_of(2**27) as large, keeper_of(1) as small:
        for keeper in (large, small):
            assert keeper.stdout.readline() == b"held\n"
        with watched_memory(lambda: [large.pid, small.pid], limit_gib=1 / 16) as killed:
            assert large.wait(timeout=30) == 0  # a keeper ends with its worker
        assert killed == {large.pid}
        assert small.poll() is None


def tell_pid(task):
    return os.getpid()


def test_a_worker_that_dies_between_tasks_costs_none():
    with closing(TaskPool(tell_pid, 1, LIMITS)) as pool:
        pool.submit(1)
        ((_, first),) = pool.wait_any()
        keeper = psutil.Process(first).parent()
        os.kill(first, signal.SIGKILL)
        wait_until(lambda: keeper.status() == psutil.STATUS_ZOMBIE)
        pool.submit(2)
        ((task, second),) = pool.wait_any()
        assert task == 2
        assert isinstance(second, int)
        assert second != first
        assert list(pool.wait_any()) == []  # nothing is left to wait for


def nap(seconds: float) -> float:
    time.sleep(seconds)
    return seconds


def test_a_clock_that_is_set_costs_no_task(monkeypatch):
    hours = count(step=3600)
    monkeypatch.setattr(time, "time", lambda: float(next(hours)))
    assert list(run_tasks([0.3, 0.3], nap, 1, LIMITS)) == [(0.3, 0.3), (0.3, 0.3)]


# It holds memory once the ids are written down: the limit must not end the worker before.
HELD = """
import os, time
while not os.path.exists({file!r}): time.sleep(0.01)
held = bytearray({bytes}); print("held", flush=True); time.sleep(600)
"""


def start_children(task: tuple[str, Path]) -> str:
    """Start three processes, write their ids down, and end as the task says.

    One is a child as usual, one leads a session, one is an orphan in a session of its own.
    """
    how, file = task
    size = 2**28 if how == "hold" else 1
    command = [sys.executable, "-c", HELD.format(bytes=size, file=str(file))]
    orphan = (
        f"import subprocess; print(subprocess.Popen({command}, start_new_session=True, "
        "stdout=subprocess.DEVNULL).pid)"
    )
    children = [
        subprocess.Popen(command, stdout=subprocess.PIPE, start_new_session=session)
        for session in (False, True)
    ]
    pids = [child.pid for child in children]
    pids.append(int(subprocess.check_output([sys.executable, "-c", orphan])))
    (file.parent / "worker").write_text(str(os.getpid()))
    file.with_suffix(".part").write_text(" ".join(map(str, pids)))
    file.with_suffix(".part").rename(file)
    for child in children:
        assert child.stdout.readline() == b"held\n"
    if how == "crash":
        os.kill(os.getpid(), signal.SIGSEGV)
    if how in ("hang", "hold"):
        time.sleep(600)
    return how


def is_alive(pid: int) -> bool:
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def wait_until(condition):
    deadline = time.monotonic() + 60
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux hands orphans to a worker")
@pytest.mark.parametrize(
    ("how", "limits", "result"),
    [
        ("return", LIMITS, "return"),
        ("crash", LIMITS, WorkerFailure("crash", "the worker died (SIGSEGV)")),
        pytest.param(
            *("hang", Limits(3.0, 8.0), WorkerFailure("timeout", "no result within 3 s")),
            marks=pytest.mark.slow,
        ),
        pytest.param(
            *(
                "hold",
                Limits(60.0, 0.6),
                WorkerFailure("memory", "the worker used more than 0.6 GiB"),
            ),
            marks=[pytest.mark.slow, pytest.mark.memory],
        ),
    ],
)
def test_what_a_worker_has_started_ends_with_its_task(tmp_path, how, limits, result):
    file = tmp_path / "pids"
    tasks = [(how, file), ("return", tmp_path / "more")]
    with closing(run_tasks(tasks, start_children, 1, limits)) as stream:
        assert next(stream)[1] == result
        assert not any(map(is_alive, map(int, file.read_text().split())))


KILLED_RUN = """
import sys
from pathlib import Path
from bench.running.pool import Limits, run_tasks
if __name__ == "__main__":
    sys.path[:0] = sys.argv[1:2]
    from test_pool import start_children
    list(run_tasks([("hang", Path(sys.argv[2]))], start_children, 1, Limits(60.0, 8.0)))
"""


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux hands orphans to a worker")
def test_a_worker_and_what_it_has_started_do_not_outlive_a_killed_run(tmp_path):
    (tmp_path / "run.py").write_text(KILLED_RUN)
    file = tmp_path / "pids"
    command = [sys.executable, tmp_path / "run.py", Path(__file__).parent, file]
    with subprocess.Popen(command) as process:
        wait_until(file.exists)
        process.kill()
    pids = [
        int(pid) for place in ("worker", "pids") for pid in (tmp_path / place).read_text().split()
    ]
    wait_until(lambda: not any(map(is_alive, pids)))


def fork_thrice(_) -> str:
    """Hold 0.4 GiB in a process and share it with three more for a second."""
    held = np.ones(2**28 // 5)
    children = []
    for _ in range(3):
        if (child := os.fork()) == 0:
            time.sleep(1.0)
            os._exit(int(held[0]))
        children.append(child)
    return " ".join(str(os.waitpid(child, 0)[1] >> 8) for child in children)


@pytest.mark.slow
@pytest.mark.memory
def test_memory_that_processes_of_a_worker_share_counts_once():
    done = run_tasks([0], fork_thrice, 1, Limits(60.0, 0.9))
    assert [result for _, result in done] == ["1 1 1"]


def test_what_a_task_raises_is_raised(tmp_path):
    with pytest.raises(KeyError, match="raise"):
        list(run_tasks([("raise", tmp_path)], misbehave, 1, LIMITS))


REPLACING = """
from bench.running.pool import Limits, run_tasks
from data_prep.rendering.opengl import gl_renderer
def draw(_):
    return bool(gl_renderer())
if __name__ == "__main__":
    # at the end, another worker is just starting
    print(len(list(run_tasks(range(3), draw, 2, Limits(60.0, 4.0), tasks_per_worker=1))))
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

    def infinite():
        for number in count():
            taken.append(number)
            yield number

    with closing(run_tasks(infinite(), square, 1, LIMITS)) as stream:
        assert len(list(islice(stream, 5))) == 5
    assert len(taken) <= 5 + 2
