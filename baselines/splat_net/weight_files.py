"""Which weights are bundled, and their checksums. Needs no torch."""

from __future__ import annotations

from pathlib import Path

from learning.weight_files import find_file

FOLDER = Path(__file__).parent / "weights"
BUNDLED: dict[str, str] = {  # name -> sha256 of weights/<name>.safetensors
    "chair": "f39359f7d39ea636d9e7a3a5dcedb10ed092fb3c7ceee040ecf50a80578ce77d",
    "chair-grey": "6b3da32118eaced060bf6812172a2cabac69b8d12050bbfb16b3dcf01c7588e1",
}


def find_weights(name_or_path: str | Path) -> Path:
    """The file of a bundled name, its checksum verified, or the path itself.

    Raises BadInput, naming file, value and remedy, where a name is unknown, a file is missing, or a
    bundled file differs from its checksum.
    """
    return find_file(name_or_path, FOLDER, BUNDLED)
