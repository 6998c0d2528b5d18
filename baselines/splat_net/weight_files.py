"""Which weights are bundled, and their checksums. Needs no torch."""

from __future__ import annotations

from pathlib import Path

from learning.weight_files import find_file

FOLDER = Path(__file__).parent / "weights"
BUNDLED: dict[str, str] = {  # name -> sha256 of weights/<name>.safetensors
    "chair": "4fd59c7c06567f4c19360be9c1954f8c2b0a16c017614dd8dfb93f59131a677c",
    "chair-grey": "2ddba23294142dc7c54f3d6a4fe2c14afceb4d6f58f9c25983367aec3dc2d601",
    "chair-large": "c5b99f8e38e87efc8e67e82b7cd8d700fa35c524c3933e67eac9fdb99a512f7a",
    "chair-no-normals": "b411d622ce88468a6ae2a1403657c5e994608d22a47a23eecebe6927f70d7250",
    "chair-tiny": "d862563619856ee2392310c2d0a885bcd1bb7575515b5d4db642d56e99c3647a",
}


def find_weights(name_or_path: str | Path) -> Path:
    """The file of a bundled name, its checksum verified, or the path itself.

    Raises BadInput, naming file, value and remedy, where a name is unknown, a file is missing, or a
    bundled file differs from its checksum.
    """
    return find_file(name_or_path, FOLDER, BUNDLED)
