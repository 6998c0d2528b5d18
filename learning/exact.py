"""The arithmetic in which networks measure: float32 in full, on every device."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import torch


@contextmanager
def exact_inference() -> Iterator[None]:
    """Compute without gradients and in full float32 within the block, also on a GPU.

    TensorFloat-32, PyTorch's default for convolutions on a GPU, keeps 10 of the 23 bits behind the
    point: values would move in the third digit, and a distance of two sets of images would depend
    on the device on which each was measured. Kernels are deterministic for the same reason: the
    same images have the same values each time. Nothing of it changes a bit on a CPU.
    """
    exact = torch.backends.cudnn.flags(enabled=True, deterministic=True, allow_tf32=False)
    with torch.inference_mode(), exact:
        yield
