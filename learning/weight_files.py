"""Weights as files on disk, whoever wrote them: found, checked, and asked how they were trained.

Needs no torch.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path

from data_prep.failures import BadInput
from data_prep.untrusted import is_regular_file, open_file

MOST_BYTES = 2**32  # of weights or a checkpoint; pc2pix at the paper's width has one of 1.2 GB
MOST_HEADER_BYTES = 2**24
MOST_OBJECTIVE_LENGTH = 100


def find_file(name_or_path: str | Path, folder: Path, bundled: Mapping[str, str]) -> Path:
    """The file of a bundled name (name -> sha256), its checksum verified, or the path itself.

    Raises BadInput, naming file, value and remedy, where a name is unknown, a file is missing, or a
    bundled file differs from its checksum.
    """
    name = str(name_or_path)
    if name not in bundled:
        path = Path(name_or_path)
        if not is_regular_file(path):
            known = ", ".join(bundled) or "none"
            raise BadInput(
                f"weights: {name!r} is neither a bundled name ({known}) nor a file; "
                "give one of these names or the path of exported weights"
            )
        return path
    path = folder / f"{name}.safetensors"
    if not is_regular_file(path):
        raise BadInput(f"{path}: the bundled weights are missing; reinstall the package")
    found = file_sha256(path)
    if found != bundled[name]:
        raise BadInput(
            f"{path}: sha256 {found} is not the expected {bundled[name]}; reinstall the package"
        )
    return path


def file_sha256(path: Path) -> str:
    """The checksum of a file. Raises BadInput where it cannot be read, or is too large."""
    with open_file(path, MOST_BYTES) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def objective_of(path: Path) -> str:
    """What exported weights were trained with, from the file's header alone; "" if it says nothing.

    A safetensors file begins with the length of its header (8 bytes, little-endian) and the header,
    which is JSON. Raises BadInput where this one does not.
    """
    with open_file(path, MOST_BYTES) as file:
        length = int.from_bytes(file.read(8), "little")
        text = file.read(min(length, MOST_HEADER_BYTES))
    try:
        if len(text) < length:
            raise ValueError(f"{length} bytes by its own account")
        training = json.loads(json.loads(text).get("__metadata__", {}).get("training", "{}"))
        objective = training.get("objective", "")
        if not isinstance(objective, str) or len(objective) > MOST_OBJECTIVE_LENGTH:
            raise ValueError("the objective is no short text")
    except (AttributeError, TypeError, ValueError, RecursionError) as error:
        raise BadInput(
            f"{path}: its header cannot be read ({error}); fetch or write the file again"
        ) from None
    return objective
