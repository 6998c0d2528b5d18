"""Files and folders that are written whole or not at all, whatever ends their process.

A file is written under another name in its own folder, forced to disk, and then renamed. A reader
of the path sees the old file or the new one, but never a part of one. With `synced=False` that does
not hold after a power cut.
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

    In the block a library may also replace the empty file by another one. Where the block is left
    by an exception, or the disk refuses, the old file stays and the new one is removed. Only a
    killed process leaves a part of a file, whose name is hidden and does not have the suffix of
    `path`. That name is random, so that several processes can write the same file at the same time;
    the last one wins.

    synced  whether to force the file to disk, which takes some milliseconds; False for many small
            files that are easily made again, as a power cut may leave parts of them

    Missing folders are made. The new file has the permissions of any new file (0666 less the
    umask), whatever the old one or the library's had. Raises OSError. Where the folder cannot be
    forced to disk, the new file is in place already.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    new = path.with_name(f".{path.name}.{secrets.token_hex(4)}")
    new.touch(exist_ok=False)
    try:
        mode = new.stat().st_mode
        yield new
        new.chmod(mode)  # safetensors replaces the file by one that only its owner can read
        if synced:
            _sync(new)
        new.replace(path)
    except BaseException:
        with suppress(OSError):  # a part that stayed would take up space on a full disk
            new.unlink()
        raise
    if synced:
        sync_folder(path.parent)


def write_whole(path: Path, data: bytes, *, synced: bool = True, remedy: str = "") -> None:
    """Write `data` with `atomic_write`.

    remedy  what the user can do where the file cannot be written; with it, CannotWrite is raised,
            which names file, reason and remedy, and without it OSError
    """
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

    Where the block is left by an exception, the folder is removed. Only a killed process leaves it
    behind, under a hidden name. Raises OSError, also where `path` exists already.
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
    """Force the names of a folder's files to disk, which the fsync of a new file does not do."""
    _sync(folder)


def _sync(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
