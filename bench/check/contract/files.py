"""The files that a method reads while it is tested, and those of them that it is not known by."""

from __future__ import annotations

import os
import sys
from collections.abc import Collection
from functools import cache
from pathlib import Path
from typing import Any

from bench.catalogue.method_files import PROJECT
from bench.running.environment import ROOT

# Suffixes of code, whose changes show in the version of a package or the checksum of the source.
_CODE = (".py", ".pyc", ".so", ".pth")
# Folders of the operating system.
_SYSTEM = ("/proc", "/sys", "/dev", "/etc", "/usr", "/lib", "/lib64", "/opt")
# Folders whose files are not looked at: the version of a package, or the machine, stands for them.
_OTHERS = (
    *(Path(folder).resolve() for folder in (sys.prefix, sys.base_prefix, *_SYSTEM)),
    *(ROOT / package for package in PROJECT),
)


@cache
def watch_files() -> set[str]:
    """Begin to note the paths that Python opens for reading; return the set that they are put in.

    Files that a library opens without Python, as safetensors does, are not noticed.
    """
    opened = set[str]()

    def note(event: str, arguments: tuple[Any, ...]) -> None:
        if event != "open":
            return
        path, _, flags = arguments
        reads = isinstance(flags, int) and flags & os.O_ACCMODE == os.O_RDONLY
        if reads and isinstance(path, (str, bytes)):
            opened.add(os.path.abspath(os.fsdecode(path)))  # noqa: PTH100 -- as cheap as can be

    sys.addaudithook(note)
    return opened


def unknown_files(opened: Collection[str], known: Collection[Path]) -> list[Path]:
    """Return the data files among the paths in `opened` that are not in `known`, sorted."""
    files = {Path(path).resolve() for path in opened if _is_data(Path(path))}
    return sorted(
        file
        for file in files - {*known}
        if file.is_file() and not any(file.is_relative_to(folder) for folder in _OTHERS)
    )


def _is_data(path: Path) -> bool:
    """Return whether a path may be that of data: not code, a hidden cache or package metadata."""
    hidden = any(part.startswith(".") for part in path.parts)
    of_package = any(part.endswith((".egg-info", ".dist-info")) for part in path.parts)
    return path.suffix not in _CODE and not hidden and not of_package
