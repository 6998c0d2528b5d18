"""A convolution for inference, whose kernel is brought into the fastest memory layout once.

That is the layout of oneDNN. PyTorch has operators for it without a public name
(`torch.ops.mkldnn`, behind torch.compile); without them, and on other devices, its public
convolution is called.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Literal

import torch
from torch import Tensor, nn
from torch.nn import functional
from torch.nn.utils.fusion import fuse_conv_bn_eval

Precision = Literal["float32", "bfloat16"]
_DTYPES: dict[Precision, torch.dtype] = {"float32": torch.float32, "bfloat16": torch.bfloat16}


def dtype_of(precision: Precision) -> torch.dtype:
    """Return the PyTorch type for a precision. Raises ValueError for an unknown one."""
    if precision not in _DTYPES:
        raise ValueError(f"precision must be {' or '.join(_DTYPES)}, got {precision!r}")
    return _DTYPES[precision]


class Convolution:
    """A convolution with a kernel laid out for a size of input; others work, more slowly.

    kernel   [cout, cin, K, K], float64
    bias     [cout] or None, float64
    like     shape [B, cin, H, W] of inputs
    relu     whether a ReLU follows, in the same pass over memory
    """

    def __init__(
        self,
        kernel: Tensor,
        bias: Tensor | None,
        like: Sequence[int],
        dtype: torch.dtype,
        *,
        stride: int = 1,
        padding: int = 0,
        relu: bool = False,
    ) -> None:
        self.relu = relu
        self.stride = stride
        self.padding = padding
        self.bias = None if bias is None else bias.to(dtype)
        weight = kernel.to(dtype, memory_format=torch.channels_last)
        self.prepacked = _prepacks(weight)
        if self.prepacked:
            weight = torch.ops.mkldnn._reorder_convolution_weight(
                weight, [padding] * 2, [stride] * 2, [1, 1], 1, list(like)
            )
        self.weight = weight

    def __call__(self, x: Tensor) -> Tensor:
        """Convolve [B, cin, H, W] -> [B, cout, H', W'], both channels last."""
        if not self.prepacked:
            y = functional.conv2d(
                x, self.weight, self.bias, stride=self.stride, padding=self.padding
            )
            return y.relu_() if self.relu else y
        return torch.ops.mkldnn._convolution_pointwise(
            x, self.weight, self.bias, [self.padding] * 2, [self.stride] * 2, [1, 1], 1,
            "relu" if self.relu else "none", [], "",
        )  # fmt: skip


def normalisation(bn: nn.BatchNorm2d) -> tuple[Tensor, Tensor]:
    """Return scale and shift [c], float64, to which BatchNorm in evaluation mode reduces."""
    assert bn.running_mean is not None
    assert bn.running_var is not None
    scale = bn.weight.double() / torch.sqrt(bn.running_var.double() + bn.eps)
    return scale, bn.bias.double() - bn.running_mean.double() * scale


def _prepacks(weight: Tensor) -> bool:
    mkldnn = torch.backends.mkldnn
    if weight.device.type != "cpu" or not (mkldnn.is_available() and mkldnn.enabled):
        return False
    if not hasattr(torch.ops.mkldnn, "_convolution_pointwise"):
        return False
    bfloat16 = weight.dtype == torch.bfloat16 and torch.ops.mkldnn._is_mkldnn_bf16_supported()
    return weight.dtype == torch.float32 or bfloat16  # float64 has no such layout


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
