"""Checksums of files, and of all the files behind an object."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from data_prep.failures import BadInput
from data_prep.files.safe_read import open_file

# The largest file of weights or checkpoint. That of pc2pix at the paper's width has 1.2 GB.
MOST_BYTES = 2**32


def file_sha256(path: Path) -> str:
    """Return the SHA-256 of a file, read piece by piece. Raises BadInput as `open_file` does."""
    with open_file(path, MOST_BYTES) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def fingerprint_of(
    version: str,
    file: Path,
    resources: Callable[[], Iterable[Path]],
    most_bytes: int,
) -> str:
    """Return the SHA-256 of a version, a file, and the names and contents of its resources.

    resources   the function that returns the further files
    most_bytes  the largest size of each file

    Where one of the files cannot be read, the result says so instead: "unreadable: no such file".
    """
    digest = hashlib.sha256(version.encode())
    path = file
    try:
        _update(digest, path, most_bytes)
        for path in resources():
            digest.update(os.fsencode(path.name))
            _update(digest, path, most_bytes)
    except (BadInput, OSError) as error:
        return "unreadable: " + str(error).removeprefix(f"{path}: ")
    return digest.hexdigest()


def _update(digest: Any, path: Path, most_bytes: int) -> None:
    """Update a hash with the contents of a file, piece by piece."""
    with open_file(path, most_bytes) as file:
        hashlib.file_digest(file, lambda: digest)
