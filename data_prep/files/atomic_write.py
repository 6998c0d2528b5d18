"""Files and folders that are written whole or not at all, whatever ends their process.

A file is written under another name in its own folder, forced to disk, and renamed. A reader of the
path sees the old file or the new one, never a part; also after a power cut, unless `synced=False`.
"""

from __future__ import annotations

import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from data_prep.failures import CannotWrite


@contextmanager
def atomic_write(path: Path, *, synced: bool = True) -> Iterator[Path]:
    """Yield an empty file beside `path`, to be written in the block; then rename it to `path`.

    A library may also put another file in its place. Where the block is left by an exception, or
    the disk refuses, the old file stays and the new one is removed. Only a killed process leaves a
    part: hidden, and without the suffix of `path`. The name is random, so that processes that
    write one file at the same time do not meet; the last one wins.

    synced  force it to disk, some milliseconds; False for many small files that are easily made
            again after a power cut, which may leave parts of them

    Missing folders are made. The rights are those of a new file (0666 less the umask),
    whatever the old one or the library had. Raises OSError; when the folder cannot be forced to
    disk, the new file has its name already.
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
        with suppress(OSError):  # a part would fill the disk further
            new.unlink()
        raise
    if synced:
        sync_folder(path.parent)


def write_whole(path: Path, data: bytes, *, synced: bool = True, remedy: str = "") -> None:
    """Write `data` by way of `atomic_write`; with a `remedy`, CannotWrite names file and reason."""
    try:
        with atomic_write(path, synced=synced) as new:
            new.write_bytes(data)
    except OSError as error:
        if not remedy:
            raise
        raise CannotWrite(f"{path}: cannot be written ({error.strerror}); {remedy}") from error


@contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """Yield an empty folder beside `path`, to be filled in the block; then rename it to `path`.

    Where the block is left by an exception, the folder is removed; only a killed process leaves it,
    hidden. Raises OSError, also where `path` exists.
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
    """Force the list of a folder's files to disk: the fsync of a new file does not."""
    _sync(folder)


def _sync(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
