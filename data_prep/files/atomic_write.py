"""Files and folders that are written whole or not at all, whatever ends their process.

A file is written under another name in its own folder, forced to disk, and renamed. Who reads the
path sees the old file or the new one, never a part; also after a power cut, unless `synced=False`.
"""

from __future__ import annotations

import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


@contextmanager
def atomic_write(path: Path, *, synced: bool = True) -> Iterator[Path]:
    """An empty file beside `path`, to be written in the block; at its end it becomes `path`.

    For what a library writes by itself; it may also put another file in its place. Where the block
    is left by an exception, or the disk refuses, the old file stays and nothing else is left. Only
    a process that is killed leaves what it had: hidden, and without the suffix of `path`. The name
    is random, so that those who write one file at once do not meet; the last one wins.

    synced  force it to disk, some milliseconds; False for many small files that are easily made
            again after a power cut, which may leave parts of them

    Folders are made where there are none. The rights are those of a new file (0666 less the umask),
    whatever the old one or the library had. Raises OSError; when it is the folder that cannot be
    forced to disk, the new file is already there.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    new = path.with_name(f".{path.name}.{secrets.token_hex(4)}")
    new.touch(exist_ok=False)
    try:
        mode = new.stat().st_mode
        yield new
        new.chmod(mode)  # safetensors makes a file of its own, for its owner alone
        if synced:
            _sync(new)
        new.replace(path)
    except BaseException:
        with suppress(OSError):  # what there is of it would fill the disk further
            new.unlink()
        raise
    if synced:
        sync_folder(path.parent)


def write_whole(path: Path, data: bytes, *, synced: bool = True) -> None:
    """Write `data` as a `atomic_write`."""
    with atomic_write(path, synced=synced) as new:
        new.write_bytes(data)


@contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """An empty folder beside `path`, to be filled in the block; at its end it becomes `path`.

    Where the block is left by an exception, nothing is left; only a process that is killed leaves
    what it had, hidden. Raises OSError, also where something else is at `path`.
    """
    new = path.with_name(f".{path.name}.{secrets.token_hex(4)}")
    new.mkdir(parents=True)
    try:
        yield new
        new.rename(path)
    except BaseException:
        shutil.rmtree(new, ignore_errors=True)
        raise
    sync_folder(path.parent)


def sync_folder(folder: Path) -> None:
    """Put on disk which files a folder has: a new file's own fsync does not."""
    _sync(folder)


def _sync(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
