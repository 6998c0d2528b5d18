"""Traces that code of a plug-in leaves in its process: output, files, threads, processes."""

from __future__ import annotations

import os
import sys
import tempfile
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import psutil

GRACE_S = 0.5  # for processes that are about to end
MOST_SHOWN = 60  # characters of an output, or names of a list


@dataclass(frozen=True)
class ProcessState:
    """The state of this process outside its variables.

    Attributes
    ----------
    folder : str
        The working folder.
    files : mapping
        Time of the last change, by path: entries of the working folder, everything in the
        temporary folder.
    threads : mapping
        Names by identifier, of the threads that Python knows.
    processes : mapping
        Names by process id, of the descendants that still run.
    """

    folder: str
    files: Mapping[str, int]
    threads: Mapping[int, str]
    processes: Mapping[int, str]

    @classmethod
    def take(cls, temporary: Path) -> ProcessState:
        """Return the current state; `temporary` is the folder for temporary files."""
        folder = os.getcwd()  # noqa: PTH109
        times = {  # of a folder, only that it exists
            str(path): 0 if path.is_dir() else path.lstat().st_mtime_ns
            for path in temporary.rglob("*")
        }
        return cls(
            folder,
            _changed_at(folder) | times,
            {thread.ident or 0: thread.name for thread in threading.enumerate()},
            {process.pid: name for process, name in _descendants()},
        )


def traces(before: ProcessState, after: ProcessState) -> dict[str, str]:
    """Return the changes between two states in words, by kind."""
    by_kind = {}
    files = sorted(path for path, time in after.files.items() if before.files.get(path) != time)
    if files:
        by_kind["files left"] = f"{len(files)} ({_some(files)})"
    threads = [name for id_, name in after.threads.items() if id_ not in before.threads]
    if threads:
        by_kind["threads left"] = f"{len(threads)} ({_some(threads)})"
    processes = [name for id_, name in after.processes.items() if id_ not in before.processes]
    if processes:
        by_kind["processes left"] = f"{len(processes)} ({_some(processes)})"
    if before.folder != after.folder:
        by_kind["working folder"] = f"changed to {after.folder}"
    return by_kind


def end_processes() -> None:
    """Kill all descendants of this process."""
    import psutil

    for process, _ in _descendants():
        try:
            process.kill()
        except psutil.Error:  # it has ended meanwhile
            continue


def await_processes() -> None:
    """Wait a moment for descendants that are about to end."""
    import psutil

    running = [process for process, _ in _descendants()]
    if running:
        psutil.wait_procs(running, timeout=GRACE_S)


@contextmanager
def captured_output() -> Iterator[Mapping[str, str]]:
    """Hold back all output to stdout and stderr, and describe it in the mapping afterwards.

    File descriptors are redirected, as native libraries and sub-processes write to them.
    """
    described: dict[str, str] = {}
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        files = {"stdout": out, "stderr": err}
        saved = [os.dup(descriptor) for descriptor in (1, 2)]
        _flush()
        try:
            for descriptor, file in zip((1, 2), files.values(), strict=True):
                os.dup2(file.fileno(), descriptor)
            yield described
        finally:
            _flush()
            for descriptor, copy in zip((1, 2), saved, strict=True):
                os.dup2(copy, descriptor)
                os.close(copy)
            for name, file in files.items():
                file.seek(0)
                if written := file.read():
                    first = written.decode(errors="replace").strip().partition("\n")[0]
                    described[name] = f"{len(written)} bytes: {first[:MOST_SHOWN]!r}"


def _flush() -> None:
    for stream in (sys.stdout, sys.stderr):
        if stream is not None and not stream.closed:
            stream.flush()


def _changed_at(folder: str) -> dict[str, int]:
    """Return the times of change of a folder's entries, without hidden ones and byte code."""
    with os.scandir(folder) as entries:
        return {
            entry.name: entry.stat(follow_symlinks=False).st_mtime_ns
            for entry in entries
            if not entry.name.startswith((".", "__pycache__"))
        }


def _descendants() -> Iterator[tuple[psutil.Process, str]]:
    """Yield the running descendants of this process, each with its name."""
    import psutil

    for process in psutil.Process().children(recursive=True):
        try:
            command = process.cmdline()
            if process.status() == psutil.STATUS_ZOMBIE:
                continue
        except psutil.Error:  # it has ended meanwhile
            continue
        # Python's own helper, which ends with the process that started it.
        if not any("resource_tracker" in word for word in command):
            yield process, command[0] if command else process.name()


def _some(names: list[str]) -> str:
    shown = ", ".join(names[:3])
    return shown + (f" and {len(names) - 3} more" if len(names) > 3 else "")
