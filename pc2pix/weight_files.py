"""Weights as files on disk: which are bundled, and their checksums. Needs no torch."""

from __future__ import annotations

import hashlib
from pathlib import Path

from data_prep.failures import BadInput

FOLDER = Path(__file__).parent / "weights"

BUNDLED = {  # name -> sha256 of weights/<name>.safetensors
    "chair": "146ad41ca2751531a2b1f9f859ff24c5d152e8711f4a1d5c6685d60601f5f251",
}


def find_weights(name_or_path: str | Path) -> Path:
    """The file of a bundled name, its checksum verified, or the path itself.

    Raises BadInput, naming file, value and remedy, where a name is unknown, a file is missing, or a
    bundled file differs from its checksum.
    """
    name = str(name_or_path)
    if name not in BUNDLED:
        path = Path(name_or_path)
        if not path.is_file():
            known = ", ".join(BUNDLED) or "none"
            raise BadInput(
                f"weights: {name!r} is neither a bundled name ({known}) nor a file; "
                "give one of these names or the path of exported weights"
            )
        return path
    path = FOLDER / f"{name}.safetensors"
    if not path.is_file():
        raise BadInput(f"{path}: the bundled weights are missing; reinstall the package")
    found = file_sha256(path)
    if found != BUNDLED[name]:
        raise BadInput(
            f"{path}: sha256 {found} is not the expected {BUNDLED[name]}; reinstall the package"
        )
    return path


def file_sha256(path: Path) -> str:
    """The checksum of a file, as in `BUNDLED`."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
