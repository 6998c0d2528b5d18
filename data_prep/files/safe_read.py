"""Untrusted files and folders: opened without waiting, read up to a stated size.

What stands under a path may be a FIFO (whose reader waits for ever), a device (which never ends), a
folder, or a file of any size; its name may hold whatever the file system allows.
"""

from __future__ import annotations

import os
import stat
import unicodedata
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from io import BufferedReader
from pathlib import Path
from typing import Any

from data_prep.failures import BadInput

MIB = 2**20
MOST_NAME_LENGTH = 200
MOST_REASON_LENGTH = 120  # of a parser's complaint


def is_regular_file(path: Path) -> bool:
    """Whether there is a file at the end of `path`, links followed.

    As `Path.is_file`, which raises where a folder may not be searched or a name is too long; here
    that is no file.
    """
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


@contextmanager
def open_file(path: Path, most_bytes: int) -> Iterator[BufferedReader]:
    """The file, open for reading.

    Raises BadInput, naming the file: missing, not to be read, no regular file, or of more than
    `most_bytes`. The size is that of the open file, so nobody can exchange it in between.
    """
    try:
        file = open(os.fspath(path), "rb", opener=_open_without_waiting)  # noqa: SIM115
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        raise BadInput(f"{path}: {_why(error)}") from error
    with file:
        status = os.fstat(file.fileno())
        if not stat.S_ISREG(status.st_mode):
            raise BadInput(f"{path}: no regular file but a pipe or device; give a file")
        if status.st_size > most_bytes:
            raise BadInput(
                f"{path}: {status.st_size} bytes, and at most {most_bytes} are read; "
                "give a smaller file"
            )
        yield file


def _open_without_waiting(path: str, flags: int) -> int:
    return os.open(path, flags | os.O_NONBLOCK)


def read_file(path: Path, most_bytes: int) -> bytes:
    """All bytes of a file. Raises BadInput as `open_file`, and where reading fails."""
    with open_file(path, most_bytes) as file:
        size = os.fstat(file.fileno()).st_size
        try:
            data = file.read(size + 1)  # memory is taken for as many, whatever there is
        except OSError as error:
            raise BadInput(f"{path}: {_why(error)}") from error
    if len(data) > size:
        raise BadInput(f"{path}: more than its {size} bytes; wait until it is written")
    return data


def read_text(path: Path, most_bytes: int) -> str:
    """The UTF-8 text of a file, with or without a byte order mark. Raises BadInput as `read_file`,
    and for other encodings."""
    try:
        return read_file(path, most_bytes).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise BadInput(f"{path}: not UTF-8 at byte {error.start}; fetch it again") from None


def reason_of(error: Exception) -> str:
    """What a parser complains of, in one line that is not too long."""
    lines = str(error).splitlines()
    return lines[0][:MOST_REASON_LENGTH] if lines else type(error).__name__


def shown(value: str | bytes, most: int = 40) -> str:
    """A value from a file as it is quoted in a message: in quotes, escaped, not too long."""
    cut = value if len(value) <= most else value[:most]
    text = repr(cut).removeprefix("b")
    return text if cut is value else f"{text}..."


def plain_name(value: Any) -> str:
    """The value, where it can be nothing but the name of a file or folder.

    Raises ValueError: no text as in `plain_text`, "." or "..", or a path.
    """
    name = plain_text(value)
    if name in (".", "..") or "/" in name or "\\" in name:
        raise ValueError(f"{shown(name)} is a path, not an id")
    return name


def plain_text(value: Any) -> str:
    """The value, where it is a text of sane length without control characters.

    Category C of Unicode: control and format characters, surrogates, what is not assigned. Raises
    ValueError.
    """
    if not isinstance(value, str):
        raise ValueError(f"{shown(repr(value))} is not a text")
    if not 1 <= len(value) <= MOST_NAME_LENGTH:
        raise ValueError(f"{shown(value)} has {len(value)} characters, not 1..{MOST_NAME_LENGTH}")
    if any(unicodedata.category(c).startswith("C") for c in value):
        raise ValueError(f"{shown(ascii(value))} has characters that cannot be seen")
    return value


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


def files_in(folder: Path, suffixes: Sequence[str]) -> tuple[Path, ...]:
    """The regular files directly in a folder with one of these suffixes, sorted.

    Raises BadInput as `files_below`.
    """
    found = []
    for path, is_folder in _entries(folder):
        if not is_folder and path.suffix.lower() in suffixes and is_regular_file(path):
            check_name(path, folder)
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


def _why(error: OSError | ValueError) -> str:
    if isinstance(error, FileNotFoundError):
        return "no such file"
    if isinstance(error, IsADirectoryError):
        return "a folder; give a file"
    reason = (error.strerror if isinstance(error, OSError) else None) or str(error)
    return f"cannot be read ({reason})"


def _entries(folder: Path) -> Iterator[tuple[Path, bool]]:
    """Paths, and whether each is a folder and no link to one."""
    try:
        with os.scandir(folder) as entries:
            for entry in entries:
                yield folder / entry.name, entry.is_dir(follow_symlinks=False)
    except OSError as error:
        raise BadInput(
            f"{folder}: cannot be read ({error.strerror}); fix this, or give another folder"
        ) from error
