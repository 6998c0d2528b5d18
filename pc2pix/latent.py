"""Arithmetic of codes: paths between two of them, and A - B + C (the paper's Figures 5 and 6).

Codes are *whitened*, as `Pc2pixRenderer.prepare` gives them and as decoder and generator take them:
(code - mean) / std over the training set, so that no number outweighs another by its unit alone.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from learning.exact import exact_inference
from pc2pix.model import Decoder


def interpolate(start: Tensor, end: Tensor, positions: int) -> Tensor:
    """Return codes [positions, d], evenly spaced from `start` to `end`, both [1, d].

    The first is `start` and the last is `end`, bit for bit. Raises ValueError for fewer than two
    positions, and where a shape is not [1, d].
    """
    if positions < 2:
        raise ValueError(f"positions: a path has at least its 2 ends, got {positions}")
    _require_codes(start=start, end=end)
    share = torch.linspace(0, 1, positions, dtype=start.dtype, device=start.device)[:, None]
    # this form, unlike start + share * (end - start), is exact at both ends
    return (1 - share) * start + share * end


def add_difference(a: Tensor, b: Tensor, c: Tensor) -> Tensor:
    """Return A - B + C of codes [1, d]: `c`, plus what `a` has and `b` has not.

    The result is exactly `c` where a is b.

    Raises ValueError where a shape is not [1, d].
    """
    _require_codes(a=a, b=b, c=c)
    return (a - b) + c


@exact_inference()
def decode(decoder: Decoder, codes: Tensor) -> NDArray[np.float32]:
    """Return clouds float32 [K, 2048, 3] in (-1, 1) of codes [K, d], on the CPU.

    They are decoded one by one, so that a cloud does not depend on its neighbours, bit for bit.
    """
    return torch.cat([decoder(code[None]) for code in codes]).float().cpu().numpy()


def _require_codes(**codes: Tensor) -> None:
    for name, code in codes.items():
        if code.dim() != 2 or len(code) != 1:
            raise ValueError(f"{name}: expected a code [1, d], got shape {list(code.shape)}")
    if len({code.shape for code in codes.values()}) > 1:
        shapes = ", ".join(f"{name} {list(code.shape)}" for name, code in codes.items())
        raise ValueError(f"codes of different lengths: {shapes}")
