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

_CODE = (".py", ".pyc", ".so", ".pth")  # which versions and the checksum of the source stand for
_SYSTEM = ("/proc", "/sys", "/dev", "/etc", "/usr", "/lib", "/lib64", "/opt")
_OTHERS = (  # folders whose files versions stand for, or the machine
    *(Path(folder).resolve() for folder in (sys.prefix, sys.base_prefix, *_SYSTEM)),
    *(ROOT / package for package in PROJECT),
)


@cache
def watch_files() -> set[str]:
    """Have this process note the paths that Python opens for reading from now on; return them.

    Libraries that open files by themselves, as safetensors does, are not noticed.
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
    """Return the data files among opened paths that are not known, sorted."""
    files = {Path(path).resolve() for path in opened if _is_data(Path(path))}
    return sorted(
        file
        for file in files - {*known}
        if file.is_file() and not any(file.is_relative_to(folder) for folder in _OTHERS)
    )


def _is_data(path: Path) -> bool:
    """Return whether a path is that of a data file: no code, no cache, no facts on a package."""
    hidden = any(part.startswith(".") for part in path.parts)
    of_package = any(part.endswith((".egg-info", ".dist-info")) for part in path.parts)
    return path.suffix not in _CODE and not hidden and not of_package
