"""Arithmetic of codes: paths between two codes, and A - B + C (the paper's Figures 5 and 6).

Codes are whitened, (code - mean) / std over the training set, as `Pc2pixRenderer.prepare` returns
them and as decoder and generator take them. So all numbers of a code count alike.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from learning.exact import exact_inference
from pc2pix.model import Decoder


def interpolate(start: Tensor, end: Tensor, positions: int) -> Tensor:
    """Return `positions` codes evenly spaced on the line from `start` to `end`, [positions, d].

    start, end  codes [1, d]; the first and the last of the result, bit for bit

    Raises ValueError for fewer than two positions, and where a shape is not [1, d].
    """
    if positions < 2:
        raise ValueError(f"positions: a path has at least its 2 ends, got {positions}")
    _require_codes(start=start, end=end)
    share = torch.linspace(0, 1, positions, dtype=start.dtype, device=start.device)[:, None]
    # Unlike start + share * (end - start), this is exact at both ends.
    return (1 - share) * start + share * end


def add_difference(a: Tensor, b: Tensor, c: Tensor) -> Tensor:
    """Return the code a - b + c, [1, d]: it changes `c` by the difference between `a` and `b`.

    Where a equals b the result is c, bit for bit.

    Raises ValueError where a shape is not [1, d].
    """
    _require_codes(a=a, b=b, c=c)
    return (a - b) + c


@exact_inference()
def decode(decoder: Decoder, codes: Tensor) -> NDArray[np.float32]:
    """Return the clouds of whitened codes [K, d], float32 [K, 2048, 3] in (-1, 1).

    They are decoded one by one, so that no bit of a cloud depends on the other codes.
    """
    return torch.cat([decoder(code[None]) for code in codes]).float().cpu().numpy()


def _require_codes(**codes: Tensor) -> None:
    """Raise ValueError unless all codes are [1, d] with the same d; keywords are their names."""
    for name, code in codes.items():
        if code.dim() != 2 or len(code) != 1:
            raise ValueError(f"{name}: expected a code [1, d], got shape {list(code.shape)}")
    if len({code.shape for code in codes.values()}) > 1:
        shapes = ", ".join(f"{name} {list(code.shape)}" for name, code in codes.items())
        raise ValueError(f"codes of different lengths: {shapes}")
