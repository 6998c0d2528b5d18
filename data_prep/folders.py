"""What lies in a folder that nobody vouches for: files and folders, by names that are text."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path

from data_prep.failures import BadInput
from data_prep.untrusted import is_regular_file, shown


def files_below(root: Path, suffixes: Sequence[str]) -> tuple[Path, ...]:
    """All regular files with one of these suffixes, sorted.

    Links to folders are not followed, so that no circle matters. Raises BadInput for a folder that
    cannot be read, and for a name that is no text: records are.
    """
    found, waiting = [], [root]
    while waiting:
        for path, is_folder in _entries(waiting.pop()):
            if is_folder:
                waiting.append(path)
            elif path.suffix.lower() in suffixes and is_regular_file(path):
                check_name(path, root)
                found.append(path)
    return tuple(sorted(found))


def folders_in(folder: Path) -> tuple[Path, ...]:
    """The folders directly in a folder, sorted; links to folders count.

    Raises BadInput as `files_below`.
    """
    found = []
    for path, is_folder in _entries(folder):
        if is_folder or path.is_dir():
            check_name(path, folder)
            found.append(path)
    return tuple(sorted(found))


def check_name(path: Path, root: Path) -> None:
    """Raises BadInput where the name of `path` below `root` is no text."""
    try:
        str(path.relative_to(root)).encode()
    except UnicodeEncodeError:
        raise BadInput(
            f"{root}: the name {shown(os.fsencode(path.relative_to(root)))} is not UTF-8; rename it"
        ) from None


def _entries(folder: Path) -> Iterator[tuple[Path, bool]]:
    """Paths, and whether each is a folder and no link to one."""
    try:
        with os.scandir(folder) as entries:
            for entry in entries:
                yield folder / entry.name, entry.is_dir(follow_symlinks=False)
    except OSError as error:
        raise BadInput(
            f"{folder}: cannot be read ({error.strerror}); mend it, or give another folder"
        ) from error
