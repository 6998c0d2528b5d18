"""Which weights are bundled, and their checksums. Needs no torch."""

from __future__ import annotations

from pathlib import Path

from learning.weight_files import find_file

FOLDER = Path(__file__).parent / "weights"
BUNDLED: dict[str, str] = {  # name -> sha256 of weights/<name>.safetensors
    "chair": "66d61b5579fefe4967e9839267856fd2992be54c96e7eaf5dd9c6d29c5ed17e3",
    "chair-grey": "5cd5b83ad09ef394ae9882309ccbe7ec509d01559930af686fd24c5850df51dd",
    "chair-tiny": "7dd599c6fae9dc1d23811a85a96f06cb3cf8c2f5b39e95b7f850fa3c4b5603e9",
}


def find_weights(name_or_path: str | Path) -> Path:
    """The file of a bundled name, its checksum verified, or the path itself.

    Raises BadInput, naming file, value and remedy, where a name is unknown, a file is missing, or a
    bundled file differs from its checksum.
    """
    return find_file(name_or_path, FOLDER, BUNDLED)
