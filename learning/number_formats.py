"""The arithmetic of a network in another number format than the one that it was written for.

float64 is exact enough to tell the rounding error of float32: every operation gets and gives
float64. bfloat16 and float16 are emulated: operations compute in float32 and their results are
rounded to the format, as matrix units do that sum in float32; so all networks and layers can be
compared on any processor. What the processor's own bfloat16 costs and gives is measured by the
methods with `@bf16` in their ids.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Literal

import torch
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves, tree_map_only

NumberFormat = Literal["float64", "bfloat16", "float16"]
FORMATS: dict[NumberFormat, torch.dtype] = {
    "float64": torch.float64,
    "bfloat16": torch.bfloat16,
    "float16": torch.float16,
}


@contextmanager
def in_format(name: NumberFormat) -> Iterator[None]:
    """Compute all operations of torch within the block in a number format.

    Values beyond the range of a format become infinite, as they do in it. Networks whose kernels
    lie in the layout of oneDNN compute in float32 alone: load them within `plain_layouts`.
    """
    mode = _Float64() if name == "float64" else _Rounded(FORMATS[name])
    with mode:
        yield


@contextmanager
def plain_layouts() -> Iterator[None]:
    """Lay out no kernel for oneDNN within the block, so that it can compute in any format."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "TF32 acceleration")  # of GPUs that are not used here
        with torch.backends.mkldnn.flags(enabled=False):
            yield


class _Float64(TorchDispatchMode):
    """Float64 in place of float32, in arguments, results and requested types."""

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        given = args, kwargs or {}
        if func.is_view:  # of memory that is written into later, perhaps
            return func(*args, **given[1])
        wide = tree_map_only(torch.Tensor, _widened, given)
        if func._schema.is_mutable:  # what it writes into stays where it is
            returned = func(*wide[0], **wide[1])
            pairs = list(zip(tree_leaves(given), tree_leaves(wide), strict=True))
            for before, after in pairs:
                if before is not after and isinstance(before, torch.Tensor):
                    before.copy_(after)
            originals = {id(after): before for before, after in pairs}
            return tree_map_only(
                torch.Tensor, lambda value: originals.get(id(value), value), returned
            )
        wide = tree_map_only(
            torch.dtype, lambda t: torch.float64 if t == torch.float32 else t, wide
        )
        return func(*wide[0], **wide[1])


def _widened(values: torch.Tensor) -> torch.Tensor:
    return values.double() if values.dtype == torch.float32 else values


class _Rounded(TorchDispatchMode):
    """Results of operations rounded to a format, and kept as float32."""

    def __init__(self, dtype: torch.dtype) -> None:
        super().__init__()
        self.dtype = dtype

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        def rounded(value: torch.Tensor) -> torch.Tensor:
            # A view shares the memory of a result that is rounded already.
            if value.dtype == torch.float32 and not func.is_view:
                value.copy_(value.to(self.dtype))
            return value

        return tree_map_only(torch.Tensor, rounded, func(*args, **(kwargs or {})))
