"""Untrusted files and folders: opened without waiting, and read up to a given size."""

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
# The most characters of a class or an id, which become parts of names of files; these may have 255
# bytes.
_MOST_NAME_LENGTH = 200
_MOST_REASON_LENGTH = 120  # the most characters of a parser's message that are quoted
# The most files and folders below a folder. All of Objaverse has 800,000 files.
MOST_ENTRIES = 2_000_000
# Files and folders that systems and network disks put among those of a user, in lower case.
_LEFT_BY_SYSTEMS = {
    "__macosx",
    "icon\r",
    "thumbs.db",
    "desktop.ini",
    "$recycle.bin",
    "system volume information",
    "lost+found",
    "__pycache__",
    "@eadir",
    "@recycle",
    "#recycle",
    "#snapshot",
    "~snapshot",
}


def is_regular_file(path: Path) -> bool:
    """Return whether `path` is a regular file or a link to one."""
    # Path.is_file raises where a folder may not be searched, and for a name that is too long.
    return os.path.isfile(path)  # noqa: PTH113


@contextmanager
def open_file(path: Path, most_bytes: int) -> Iterator[BufferedReader]:
    """Yield a file that is open for reading.

    Raises BadInput, which names the file, where it is missing, may not be read, is no regular file,
    or has more than `most_bytes`. Kind and size are asked of the open file, so that it cannot be
    exchanged for another one in between.
    """
    try:
        # O_NONBLOCK, as opening a named pipe without a writer would wait for ever.
        opener = lambda name, flags: os.open(name, flags | os.O_NONBLOCK)  # noqa: E731
        file = open(os.fspath(path), "rb", opener=opener)  # noqa: SIM115
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


def read_file(path: Path, most_bytes: int) -> bytes:
    """Return all bytes of a file. Raises BadInput as `open_file` does, and where reading fails."""
    with open_file(path, most_bytes) as file:
        size = os.fstat(file.fileno()).st_size
        try:
            data = file.read(size + 1)  # one byte more shows whether the file has grown meanwhile
        except OSError as error:
            raise BadInput(f"{path}: {_why(error)}") from error
    if len(data) > size:
        raise BadInput(f"{path}: more than its {size} bytes; wait until it is written")
    return data


def read_text(path: Path, most_bytes: int) -> str:
    """Return the UTF-8 text of a file without its byte order mark.

    Raises BadInput as `read_file` does, and for a file that is not UTF-8.
    """
    try:
        return read_file(path, most_bytes).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise BadInput(f"{path}: not UTF-8 at byte {error.start}; fetch it again") from None


def reason_of(error: BaseException) -> str:
    """Return the first line of an exception's message, shortened; its type if it has no message."""
    lines = str(error).splitlines()
    return lines[0][:_MOST_REASON_LENGTH] if lines else type(error).__name__


def shown(value: str | bytes, most: int = 40) -> str:
    """Return a value of a file for a message: in quotes, escaped, cut to `most` characters."""
    cut = value if len(value) <= most else value[:most]
    text = repr(cut).removeprefix("b")
    return text if cut is value else f"{text}..."


def plain_name(value: Any) -> str:
    """Return the value if it is the name of a file or folder.

    Raises ValueError as `plain_text`, and for ".", ".." and paths.
    """
    name = plain_text(value)
    if name in (".", "..") or "/" in name or "\\" in name:
        raise ValueError(f"{shown(name)} is a path, not an id")
    return name


def plain_text(value: Any) -> str:
    """Return the value if it is a text of sane length without control characters.

    Raises ValueError for others. Control characters are the category C of Unicode: control and
    format characters, surrogates, unassigned codes.
    """
    if not isinstance(value, str):
        raise ValueError(f"{shown(repr(value))} is not a text")
    if not 1 <= len(value) <= _MOST_NAME_LENGTH:
        raise ValueError(f"{shown(value)} has {len(value)} characters, not 1..{_MOST_NAME_LENGTH}")
    if any(unicodedata.category(c).startswith("C") for c in value):
        raise ValueError(f"{shown(ascii(value))} has characters that cannot be seen")
    return value


def is_disk(folder: Path) -> bool:
    """Return whether a folder is the root of the file system, "/"."""
    return folder.resolve() == Path(folder.resolve().anchor)


def is_hidden(name: str) -> bool:
    """Return whether a file or folder is passed over: hidden, or put there by a system."""
    return name.startswith((".", "~$")) or name.lower() in _LEFT_BY_SYSTEMS


def files_below(root: Path, suffixes: Sequence[str]) -> tuple[tuple[Path, ...], tuple[str, ...]]:
    """Return all regular files with one of these suffixes, and the names of all other files.

    Both are sorted. Hidden files and folders are passed over. Links to folders are not followed, as
    they may form circles. Raises BadInput for a folder that cannot be read, that is a whole disk or
    has too many entries, and for a name that is not UTF-8, which no record could hold.
    """
    if is_disk(root):
        raise BadInput(f"{root}: a whole disk; give a folder on it")
    files, others, waiting, count = [], [], [root], 0
    while waiting:
        for path, is_folder in _entries(waiting.pop()):
            count += 1
            if count > MOST_ENTRIES:
                raise BadInput(
                    f"{root}: more than {MOST_ENTRIES} files and folders are in it; give a folder "
                    "that has the meshes or clouds alone"
                )
            if is_folder:
                waiting.append(path)
            elif _is_file(path, suffixes, root):
                files.append(path)
            else:
                name = str(path.relative_to(root))
                others.append("".join(c if c.isprintable() else "\ufffd" for c in name))
    return tuple(sorted(files)), tuple(sorted(others))


def files_in(folder: Path, suffixes: Sequence[str]) -> tuple[Path, ...]:
    """Return the regular files directly in a folder with one of these suffixes, sorted.

    Raises BadInput as `files_below`.
    """
    entries = _entries(folder)
    return tuple(
        sorted(p for p, is_folder in entries if not is_folder and _is_file(p, suffixes, folder))
    )


def folders_in(folder: Path) -> tuple[Path, ...]:
    """Return the folders directly in a folder, sorted, with links to folders.

    Raises BadInput as `files_below`.
    """
    folders = []
    for path, is_folder in _entries(folder):
        if is_folder or os.path.isdir(path):  # noqa: PTH112
            _check_name(path, folder)
            folders.append(path)
    return tuple(sorted(folders))


def _is_file(path: Path, suffixes: Sequence[str], root: Path) -> bool:
    """Return whether a path is a regular file with one of the suffixes.

    Raises BadInput for a name that is not UTF-8.
    """
    wanted = path.suffix.lower() in suffixes and is_regular_file(path)
    if wanted:
        _check_name(path, root)
    return wanted


def _check_name(path: Path, root: Path) -> None:
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
    """Yield the entries of a folder, and for each whether it is a folder and not a link to one."""
    try:
        with os.scandir(folder) as entries:
            for entry in entries:
                if entry.name.startswith(".") and entry.name.endswith(".icloud"):
                    raise BadInput(
                        f"{folder / entry.name}: stands for a file that is in iCloud; download it, "
                        "or remove this name"
                    )
                if is_hidden(entry.name):
                    continue
                if "\\" in entry.name:
                    raise BadInput(
                        f"{folder}: the name {shown(os.fsencode(entry.name), 80)} has backslashes, "
                        "where an archive of Windows has folders; unpack it again with unzip or "
                        "7-Zip, or rename it"
                    )
                yield folder / entry.name, entry.is_dir(follow_symlinks=False)
    except OSError as error:
        raise BadInput(
            f"{folder}: cannot be read ({error.strerror}); fix this, or give another folder"
        ) from error
