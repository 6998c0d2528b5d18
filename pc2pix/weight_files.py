"""Weights as files on disk: which are bundled, and their checksums. Needs no torch."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

from data_prep.failures import BadInput
from data_prep.untrusted import is_regular_file, open_file

FOLDER = Path(__file__).parent / "weights"
MOST_BYTES = 2**32  # of weights or a checkpoint; at the paper's width a checkpoint has 1.2 GB
MOST_HEADER_BYTES = 2**24
MOST_OBJECTIVE_LENGTH = 100

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
    name = str(name_or_path)
    if name not in BUNDLED:
        path = Path(name_or_path)
        if not is_regular_file(path):
            known = ", ".join(BUNDLED) or "none"
            raise BadInput(
                f"weights: {name!r} is neither a bundled name ({known}) nor a file; "
                "give one of these names or the path of exported weights"
            )
        return path
    path = FOLDER / f"{name}.safetensors"
    if not is_regular_file(path):
        raise BadInput(f"{path}: the bundled weights are missing; reinstall the package")
    found = file_sha256(path)
    if found != BUNDLED[name]:
        raise BadInput(
            f"{path}: sha256 {found} is not the expected {BUNDLED[name]}; reinstall the package"
        )
    return path


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


def file_sha256(path: Path) -> str:
    """The checksum of a file, as in `BUNDLED`. Raises BadInput: not to be read, or too large."""
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
