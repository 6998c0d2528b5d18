"""Which weights are bundled, and their checksums. Needs no torch."""

from __future__ import annotations

from pathlib import Path

from learning.weight_files import find_file

FOLDER = Path(__file__).parent / "weights"
BUNDLED: dict[str, str] = {  # name -> sha256 of weights/<name>.safetensors
    "chair": "622e000f9a825f15cc334d42cdc7de34ad980e7ab94bc0fd891eb36154d5e606",
    "chair-grey": "59a432cf2994844e445b63bca5526c9e69f6219bdebdaa47d479bc4e62f63e61",
    "chair-tiny": "7dd599c6fae9dc1d23811a85a96f06cb3cf8c2f5b39e95b7f850fa3c4b5603e9",
}


def find_weights(name_or_path: str | Path) -> Path:
    """The file of a bundled name, its checksum verified, or the path itself.

    Raises BadInput, naming file, value and remedy, where a name is unknown, a file is missing, or a
    bundled file differs from its checksum.
    """
    return find_file(name_or_path, FOLDER, BUNDLED)
