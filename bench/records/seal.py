"""A checksum inside a Parquet file, compared before Arrow sees a byte of it.

Arrow ends the process, without an exception, on some files with one damaged byte in their footer.

    data | SEAL, sha256 of everything else | footer, its length, "PAR1"

The footer says where the data are, so that other readers of Parquet pass over the seal.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from hashlib import sha256
from pathlib import Path
from typing import BinaryIO

import pyarrow as pa

from data_prep.files.atomic_write import atomic_write
from data_prep.files.safe_read import MIB

SEAL = b"pc2pixSL"
_SEAL_BYTES = len(SEAL) + sha256().digest_size
_END = 8  # bytes: the length of the footer, and "PAR1"


@contextmanager
def file_with_seal(path: Path) -> Iterator[Path]:
    """Yield a file as `atomic_write`; what the block writes gets a seal before it is renamed."""
    with atomic_write(path) as new:
        yield new
        seal(new)


def seal(path: Path) -> None:
    """Put a seal into a Parquet file that Arrow has written."""
    with path.open("r+b") as file:
        footer_start = _footer_start(file)
        digest = _digest(file, footer_start, footer_start)
        file.seek(footer_start)
        footer = file.read()
        file.seek(footer_start)
        file.write(SEAL + digest + footer)


def check_seal(path: Path) -> None:
    """Compare a Parquet file to its seal.

    Raises OSError, or pyarrow.ArrowInvalid as Arrow does for a damaged file; likewise for a file
    without a seal, as version 1.0.0 wrote them.
    """
    with path.open("rb") as file:
        footer_start = _footer_start(file)
        data_end = footer_start - _SEAL_BYTES
        if data_end >= 0:
            file.seek(data_end)
            stored = file.read(_SEAL_BYTES)
            if stored.startswith(SEAL):
                if stored.removeprefix(SEAL) != _digest(file, data_end, footer_start):
                    raise pa.ArrowInvalid("damaged: its bytes do not have its checksum")
                return
    raise pa.ArrowInvalid("no checksum before its footer: damaged, or of version 1.0.0 or earlier")


def _footer_start(file: BinaryIO) -> int:
    """Return where the footer begins; anything, also a negative number, in a damaged file."""
    size = file.seek(0, os.SEEK_END)
    file.seek(max(0, size - _END))
    return size - _END - int.from_bytes(file.read(4), "little")


def _digest(file: BinaryIO, data_end: int, footer_start: int) -> bytes:
    """Return the sha256 of the data and the footer, read piece by piece."""
    digest = sha256()
    file.seek(0)
    while piece := file.read(min(MIB, data_end - file.tell())):
        digest.update(piece)
    file.seek(footer_start)
    while piece := file.read(MIB):
        digest.update(piece)
    return digest.digest()
