"""SQLite's own writes, to be counted and to fail: its layer for files has replaceable calls.

`xSetSystemCall` of the VFS "unix" is SQLite's interface for tests (sqlite.org/c3ref/vfs.html).
"""

from __future__ import annotations

import _sqlite3
import ctypes
import errno
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any


class _Vfs(ctypes.Structure):
    """The start of `sqlite3_vfs`, version 3."""

    _fields_ = [
        *((name, ctypes.c_int) for name in ("iVersion", "szOsFile", "mxPathname")),
        *(
            (name, ctypes.c_void_p)
            for name in (
                *("pNext", "zName", "pAppData", "xOpen", "xDelete", "xAccess", "xFullPathname"),
                *("xDlOpen", "xDlError", "xDlSym", "xDlClose", "xRandomness", "xSleep"),
                *("xCurrentTime", "xGetLastError", "xCurrentTimeInt64"),
                *("xSetSystemCall", "xGetSystemCall"),
            )
        ),
    ]


_INT, _LONG, _BYTES = ctypes.c_int, ctypes.c_longlong, ctypes.c_char_p
_SIZE, _POINTER = ctypes.c_size_t, ctypes.c_void_p
_SIGNATURES = {
    "write": ctypes.CFUNCTYPE(ctypes.c_ssize_t, _INT, _POINTER, _SIZE, use_errno=True),
    "pwrite": ctypes.CFUNCTYPE(ctypes.c_ssize_t, _INT, _POINTER, _SIZE, _LONG, use_errno=True),
    "pwrite64": ctypes.CFUNCTYPE(ctypes.c_ssize_t, _INT, _POINTER, _SIZE, _LONG, use_errno=True),
    "ftruncate": ctypes.CFUNCTYPE(_INT, _INT, _LONG, use_errno=True),
    "unlink": ctypes.CFUNCTYPE(_INT, _BYTES, use_errno=True),
}
_SET = ctypes.CFUNCTYPE(_INT, _POINTER, _BYTES, _POINTER)
_GET = ctypes.CFUNCTYPE(_POINTER, _POINTER, _BYTES)


@contextmanager
def failing_calls(note: Callable[[object], bool], fail: Callable[[object], None]) -> Iterator[None]:
    """Have SQLite's writes fail within the block where `note` of their path is true.

    A write that fails has written its first half, as on a full disk. `fail` raises an OSError, or
    ends the process.
    """
    library = ctypes.CDLL(_sqlite3.__file__)
    library.sqlite3_vfs_find.restype = ctypes.POINTER(_Vfs)
    vfs = library.sqlite3_vfs_find(None)
    set_call, get_call = (
        kind(getattr(vfs.contents, name))
        for kind, name in ((_SET, "xSetSystemCall"), (_GET, "xGetSystemCall"))
    )

    def replaced(name: str, real: Any) -> Any:
        def call(target: Any, *arguments: Any) -> int:
            path = os.fsdecode(target) if name == "unlink" else _path_of(target)
            if note(path):
                try:
                    if "write" in name:
                        data, size, *offset = arguments
                        real(target, data, size // 2, *offset)
                    fail(path)
                except OSError as error:
                    ctypes.set_errno(error.errno or errno.EIO)
                    return -1
            return real(target, *arguments)

        return _SIGNATURES[name](call)

    kept = []
    try:
        for name, signature in _SIGNATURES.items():
            address = get_call(ctypes.cast(vfs, _POINTER), name.encode())
            if address:
                kept.append(replaced(name, signature(address)))
                set_call(ctypes.cast(vfs, _POINTER), name.encode(), ctypes.cast(kept[-1], _POINTER))
        yield
    finally:
        for name in _SIGNATURES:
            set_call(ctypes.cast(vfs, _POINTER), name.encode(), None)


def _path_of(handle: int) -> Path:
    return Path(f"/proc/self/fd/{handle}").readlink()
