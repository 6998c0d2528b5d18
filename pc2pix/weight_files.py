"""Weights as files on disk: which are bundled, and their checksums. Needs no torch."""

from __future__ import annotations

from pathlib import Path

from data_prep.failures import BadInput
from data_prep.untrusted import is_regular_file
from learning.weight_files import file_sha256, find_file

FOLDER = Path(__file__).parent / "weights"

BUNDLED = {  # name -> sha256 of weights/<name>.safetensors
    "chair": "594e13a882832836421086630690853a4ba0c714867c5eaf772fdf4eec8be0d4",
    "chair-acgan": "bdcfbdc7b65b7b34fad0e78522caa1f3938a99d6a756b70cad4342d0cecad6a1",
    "all": "e874f6a798e4c66100ef83304d0829e61336ebbbcd69590d2e27092656ae54f3",
}

# A decoder stands beside its weights and is needed for no picture, see `pc2pix.decoder_weights`.
BUNDLED_DECODERS = {  # name -> sha256 of weights/<name>-decoder.safetensors
    "chair": "f5b7f4233c03c155535049dd17928a1b4cdc89fe10cce72b9ce2ec83dd9d68a6",
}


def find_weights(name_or_path: str | Path) -> Path:
    """The file of a bundled name, its checksum verified, or the path itself.

    Raises BadInput, naming file, value and remedy, where a name is unknown, a file is missing, or a
    bundled file differs from its checksum.
    """
    return find_file(name_or_path, FOLDER, BUNDLED)


def decoder_path(name_or_path: str | Path) -> Path:
    """Where the decoder of these weights has its place: beside them, there or not."""
    name = str(name_or_path)
    weights = FOLDER / f"{name}.safetensors" if name in BUNDLED else Path(name_or_path)
    return weights.with_name(f"{weights.stem}-decoder.safetensors")


def training_command(name_or_path: str | Path) -> str:
    """What makes the decoder of these weights."""
    return f"bench train decoder --weights {name_or_path}"


def find_decoder(name_or_path: str | Path) -> Path:
    """The file of the decoder of these weights; that of a bundled one has its checksum verified.

    Raises BadInput, with the command that makes it, where it is missing.
    """
    path = decoder_path(name_or_path)
    if not is_regular_file(path):
        raise BadInput(
            f"{path}: there is no decoder for these weights; "
            f"make it with '{training_command(name_or_path)}'"
        )
    expected = BUNDLED_DECODERS.get(str(name_or_path))
    found = file_sha256(path)
    if expected not in (None, found):
        raise BadInput(
            f"{path}: sha256 {found} is not the expected {expected}; reinstall the package, or "
            f"name the new one in {Path(__file__).name}"
        )
    return path
