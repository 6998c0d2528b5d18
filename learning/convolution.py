"""Networks for inference: normalisation folded into convolutions, channels last in memory."""

from __future__ import annotations

from itertools import pairwise
from typing import Literal

import torch
from torch import nn
from torch.nn.utils.fusion import fuse_conv_bn_eval

Precision = Literal["float32", "bfloat16"]
_DTYPES: dict[Precision, torch.dtype] = {"float32": torch.float32, "bfloat16": torch.bfloat16}


def dtype_of(precision: Precision) -> torch.dtype:
    """Return the PyTorch type for a precision. Raises ValueError for an unknown one."""
    if precision not in _DTYPES:
        raise ValueError(f"precision must be {' or '.join(_DTYPES)}, got {precision!r}")
    return _DTYPES[precision]


def fold_normalisation(network: nn.Module) -> None:
    """Change `network`, in evaluation mode, in place for inference on the CPU.

    Each BatchNorm that follows a convolution within a Sequential becomes part of it, and channels
    lie last. The answers are the same but for rounding; the weights are no longer those of a file.
    """
    for chain in network.modules():
        if not isinstance(chain, nn.Sequential):
            continue
        for i, (layer, behind) in enumerate(pairwise(chain)):
            if isinstance(layer, nn.Conv2d) and isinstance(behind, nn.BatchNorm2d):
                chain[i], chain[i + 1] = fuse_conv_bn_eval(layer, behind), nn.Identity()
    network.to(memory_format=torch.channels_last)  # pyright: ignore[reportCallIssue]
