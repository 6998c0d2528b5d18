"""Weights of DISTS in an installed package, none of whose code runs, and tensors of such files.

A file is a pickle of torch tensors: its checksum is verified first, and then torch's restricted
unpickler makes nothing but tensors of it. Nothing here imports torch before a file is read.
"""

from __future__ import annotations

import io
import pickle
from pathlib import Path
from typing import TYPE_CHECKING

from bench.metrics.lpips_weights import find_lpips_weights
from bench.metrics.packaged_weights import PackagedFile
from data_prep.failures import BadInput

if TYPE_CHECKING:
    from torch import Tensor

DISTS = PackagedFile(
    "DISTS-pytorch",
    "0.1",
    "DISTS_pytorch/weights.pt",
    "f5e65c96230b7f6ca995691647d482237e4cab8a50c5c4a5784f219ef0748218",
)


def find_dists_weights() -> Path:
    """Return the verified weights of DISTS, whose trunk has to be installed, too.

    Raises as `PackagedFile.find`.
    """
    find_lpips_weights("vgg")
    return DISTS.find()


def read_tensors(path: Path, file: PackagedFile) -> dict[str, Tensor]:
    """Return the tensors of a file by name.

    Raises BadInput where it cannot be read, is not the published one (sha256) or holds anything
    but tensors.
    """
    import torch

    data = file.read(path)
    try:
        return torch.load(io.BytesIO(data), map_location="cpu", weights_only=True)
    except (pickle.UnpicklingError, EOFError, RuntimeError, ValueError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise BadInput(f"{path}: holds no tensors ({reason}); {file.reinstall}") from error
