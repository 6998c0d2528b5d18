"""Every write of a run fails once, and every byte of its store is the last one that was written.

    python -m tests.robustness.failing_writes

What a small run writes is counted: folders, files, their bytes, renames, what is forced to disk,
and what SQLite writes into the store (`tests.robustness.sqlite_calls`). Then, for each of these
calls and each way to fail (no space left, input/output error, SIGKILL), a run fails there and is
started again. It has to fail as a user can handle it (OSError or BadInput), to leave no
half-written file behind (only SIGKILL may), to keep each result that the store had acknowledged,
and to end with the tables of a run that nobody disturbed. Figures and report are left out: they are
written as tables are, when all else is.

The last transactions of a killed run are cut after each of their bytes: the results that are whole
count, and no other (`cut_everywhere`). Prints a line for what is wrong, and a summary; the exit
status is 1 if anything is.
"""

from __future__ import annotations

import argparse
import builtins
import errno
import io
import multiprocessing
import os
import signal
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any
from unittest import mock

import pyarrow.parquet as pq

import bench.running.protocol
import bench.running.run
from bench.analysis.run import read_run
from bench.catalogue.suites import Limits
from bench.commands.terminal import LiveTable, Terminal
from bench.judges import views as _loaded_before_forks  # noqa: F401
from bench.records.folder import open_folder, open_store, read_manifest
from bench.records.job import Job, Result
from bench.records.store import STORE, Store
from bench.running.environment import environment
from bench.running.options import Options
from bench.running.run import run
from bench.running.work import run_job
from bench.tables.build import Outputs, write_outputs
from data_prep.failures import BadInput
from tests.robustness.sqlite_calls import failing_calls

KILLED = "SIGKILL"
WAYS: dict[str, int | None] = {"ENOSPC": errno.ENOSPC, "EIO": errno.EIO, KILLED: None}
ACKNOWLEDGED = "acknowledged"
PATH_CALLS = ("mkdir", "rename", "replace", "chmod")
WRITING = os.O_WRONLY | os.O_RDWR


class InProcess:
    """An executor that does jobs in this process, made as `bench.running.pool.JobPool` is."""

    capacity = 1

    def __init__(self, count: int, workers: int, limits: Limits) -> None:
        self._jobs: list[Job] = []

    def submit(self, job: Job) -> None:
        """Have a job done."""
        self._jobs.append(job)

    def wait_any(self, timeout_s: float | None = None) -> Iterator[Result]:
        """Do what was submitted."""
        while self._jobs:
            yield run_job(self._jobs.pop(0))

    def close(self) -> None:
        """There is nothing to stop."""


@dataclass
class Writes:
    """A counter of the writes below a folder, which has one of them fail.

    fails_at  the number of that call, from 1; None: none
    way       a key of WAYS
    """

    folder: Path
    fails_at: int | None = None
    way: str = KILLED
    count: int = 0

    def note(self, path: object) -> bool:
        """Count a call below the folder; return whether it is the one to fail."""
        if not str(path).startswith(str(self.folder)):
            return False
        self.count += 1
        return self.count == self.fails_at

    def fail(self, path: object) -> None:
        """Fail as the operating system would."""
        number = WAYS[self.way]
        if number is None:
            os.kill(os.getpid(), signal.SIGKILL)
        else:
            raise OSError(number, os.strerror(number), str(path))

    def check(self, path: object) -> None:
        """Count a call that writes, or fail it."""
        if self.note(path):
            self.fail(path)


def _file_type(writes: Writes) -> type[io.FileIO]:
    class File(io.FileIO):
        """A full disk takes a part of what is written."""

        def write(self, data: Any, /) -> int:
            if writes.note(self.name):
                super().write(bytes(data)[: len(data) // 2])
                writes.fail(self.name)
            return super().write(data)

    return File


@contextmanager
def failing(writes: Writes) -> Iterator[None]:
    """Count Python's writes below the folder within, and fail one of them."""
    file_type, real_open, real_os_open, real_fsync = _file_type(writes), io.open, os.open, os.fsync

    def open_(file: Any, mode: str = "r", buffering: int = -1, *text: Any, **more: Any) -> Any:
        if not set(mode) & set("wxa+") or not str(file).startswith(str(writes.folder)):
            return real_open(file, mode, buffering, *text, **more)
        writes.check(file)
        raw = file_type(file, mode.replace("b", "").replace("t", ""))
        if "+" in mode:
            return io.BufferedRandom(raw)
        binary = io.BufferedWriter(raw)
        return binary if "b" in mode else io.TextIOWrapper(binary, *text, **more)

    def os_open(path: Any, flags: int, *more: Any, **named: Any) -> int:
        if flags & WRITING:
            writes.check(path)
        return real_os_open(path, flags, *more, **named)

    def fsync(handle: Any) -> None:
        number = handle if isinstance(handle, int) else handle.fileno()
        writes.check(Path(f"/proc/self/fd/{number}").readlink())
        real_fsync(handle)

    def checked(function: Callable[..., Any], path: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any, **named: Any) -> Any:
            writes.check(path(*arguments))
            return function(*arguments, **named)

        return call

    with ExitStack() as stack:
        for name in PATH_CALLS:
            replaced = checked(getattr(os, name), lambda path, *_: path)
            stack.enter_context(mock.patch.object(os, name, replaced))
        write_table = checked(pq.ParquetWriter.write_table, lambda writer, *_: writer.where)
        stack.enter_context(mock.patch.object(pq.ParquetWriter, "write_table", write_table))
        for owner, name, ours in (
            *((builtins, "open", open_), (io, "open", open_)),
            *((os, "open", os_open), (os, "fsync", fsync)),
        ):
            stack.enter_context(mock.patch.object(owner, name, ours))
        stack.enter_context(failing_calls(writes.note, writes.fail))
        yield


def publish(directory: Path, seconds: dict[str, float]) -> Outputs:
    """Write the tables."""
    return write_outputs(read_run(directory, read_manifest(directory)))


def run_once(out: Path, writes: Writes, done: Any) -> None:
    """Carry out a small run in this process; send how many writes there were, or what ended it.

    Keys go into a file beside the run as soon as the store has acknowledged them.
    """
    keys = os.open(out.with_suffix(f".{ACKNOWLEDGED}"), os.O_CREAT | os.O_WRONLY | os.O_APPEND)
    append = Store.append

    def noted(store: Store, result: Result) -> None:
        append(store, result)
        os.write(keys, f"{result.key}\n".encode())

    sys.stdout = sys.stderr = io.StringIO()
    bench.running.run.JobPool = InProcess  # type: ignore[misc]
    options = Options(
        suite="chair-robustness",
        methods=("splat", "blank"),
        conditions=("2048", "512"),
        limit=1,
        views=1,
        workers=1,
        device="cpu",
        out=out,
    )
    with mock.patch.object(Store, "append", noted), failing(writes):
        try:
            run(options, publish, partial(Terminal, LiveTable().table))
        except (OSError, BadInput) as error:
            done.send(f"refused: {error}")
        except BaseException as error:
            done.send(f"broken: {type(error).__name__}: {error}")
        else:
            done.send(f"finished: {writes.count}")


def apart(out: Path, writes: Writes) -> str:
    """Return what `run_once` sends from a forked process, or "killed"."""
    ours, theirs = multiprocessing.Pipe(duplex=False)
    process = multiprocessing.get_context("fork").Process(
        target=run_once, args=(out, writes, theirs)
    )
    process.start()
    theirs.close()
    try:
        return ours.recv()
    except EOFError:
        return "killed"
    finally:
        process.join()


def tables(out: Path) -> dict[str, bytes]:
    """Return the bytes of the tables of a run, by file name."""
    return {path.name: path.read_bytes() for path in sorted((out / "tables").iterdir())}


def recorded(out: Path) -> set[str]:
    """Return the keys in the store of a run."""
    with open_store(out) as store:
        return {row.key for row in store.listed()}


def faults_of(out: Path, at: int, way: str, expected: dict[str, bytes]) -> list[str]:
    """Return what is wrong after a run into `out` has failed at a write and was started again."""
    ended = apart(out, Writes(out, at, way))
    survived = ended.startswith("finished")  # it can do without what it could not write
    wrong = []
    if not survived and not ended.startswith("killed" if way == KILLED else "refused"):
        wrong.append(f"the run ended with {ended!r}")
    left = [path.name for path in out.rglob(".*")] if way != KILLED else []
    if left:
        wrong.append(f"it left {', '.join(sorted(left))}")
    again = apart(out, Writes(out))
    if not again.startswith("finished"):
        return [*wrong, f"the second start ended with {again!r}"]
    present = {name: data for name, data in tables(out).items() if not name.startswith(".")}
    if present != expected:
        wrong.append("its tables are others")
    acknowledged = out.with_suffix(f".{ACKNOWLEDGED}").read_text().split()
    if Counter(acknowledged) - Counter(set(acknowledged)):
        wrong.append("a result was acknowledged, lost, and made again")
    if set(acknowledged) - recorded(out):
        wrong.append("an acknowledged result is not in the store")
    return wrong


def cut_everywhere(folder: Path, keys: Sequence[str], step: int = 1) -> Iterator[str]:
    """Yield what is wrong where the second file of a store ends after each of its bytes.

    `keys` are those of the results in it, in the order of writing: the first ones count, and the
    more the longer the file is. With `step`, it ends after each `step`th byte, and the last.
    """
    data = {name: (folder / name).read_bytes() for name in (STORE, f"{STORE}-wal")}
    size, counted = len(data[f"{STORE}-wal"]), 0
    for end in sorted({*range(0, size, step), size}):
        with tempfile.TemporaryDirectory() as part:
            (Path(part) / STORE).write_bytes(data[STORE])
            (Path(part) / f"{STORE}-wal").write_bytes(data[f"{STORE}-wal"][:end])
            with open_folder(Path(part)) as store:
                present = store.find(keys)
                if damaged := store.forget_damaged():
                    yield f"cut after {end} bytes: {damaged} results are not what was stored"
        if {*present} != {*keys[: len(present)]}:
            yield f"cut after {end} bytes: {', '.join(present)} count"
        if len(present) < counted:
            yield f"cut after {end} bytes: {len(present)} results count, before it was {counted}"
        counted = len(present)
    if counted != len(keys):
        yield f"of {len(keys)} results {counted} count in the whole file"


def main(arguments: Sequence[str] | None = None) -> int:
    """Have all writes fail; return 0 if nothing is wrong."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--every", type=int, default=1, help="only each so many-th call")
    chosen = parser.parse_args(arguments)
    wrong, actual = 0, environment()
    bench.running.protocol.environment = lambda: actual  # a second of each run
    with tempfile.TemporaryDirectory() as folder:
        alone = Path(folder) / "alone"
        ended = apart(alone, Writes(alone))
        count, expected = int(ended.removeprefix("finished: ")), tables(alone)
        calls = range(1, count + 1, chosen.every)
        for at in calls:
            for way in WAYS:
                for fault in faults_of(Path(folder) / f"{at}-{way}", at, way, expected):
                    wrong += 1
                    print(f"write {at} of {count}, {way}: {fault}", flush=True)
        print(f"{len(calls)} of {count} writes failed in {len(WAYS)} ways each: {wrong} wrong")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
