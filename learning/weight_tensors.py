"""Tensors of a weights file against the network that they are for: the file is not trusted."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import torch
from torch import Tensor, nn

from data_prep.failures import BadInput

STORED = (torch.float16, torch.float32)
COUNTER = "num_batches_tracked"  # of BatchNorm; drawing does without


def without_counters(tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """The tensors that are stored."""
    return {key: value for key, value in tensors.items() if not key.endswith(COUNTER)}


def shapes(network: nn.Module, prefix: str = "") -> dict[str, tuple[int, ...]]:
    """What a file has to hold for `network`, which may be on the meta device."""
    state = without_counters(network.state_dict())
    return {f"{prefix}{key}": tuple(value.shape) for key, value in state.items()}


def check(
    path: Path,
    tensors: Mapping[str, Tensor],
    expected: Mapping[str, tuple[int, ...]],
    remedy: str,
) -> None:
    """Raises BadInput, naming file, tensor and `remedy`, where a tensor is missing, unknown, of
    another shape or type, or not finite."""
    for key in sorted(expected.keys() ^ tensors.keys()):
        problem = "is missing" if key in expected else "is unknown"
        raise BadInput(f"{path}: tensor {key} {problem}; {remedy}")
    for key, shape in expected.items():
        if tuple(tensors[key].shape) != shape:
            found = list(tensors[key].shape)
            raise BadInput(f"{path}: {key} has shape {found}, expected {list(shape)}; {remedy}")
        if tensors[key].dtype not in STORED:
            raise BadInput(f"{path}: {key} is of {tensors[key].dtype}, not {STORED}; {remedy}")
        if not tensors[key].isfinite().all():
            raise BadInput(f"{path}: {key} is not finite; {remedy}")


def fill(network: nn.Module, tensors: Mapping[str, Tensor]) -> None:
    """Put checked tensors into `network`, in float32 and evaluation mode."""
    state = {key: value.float() for key, value in tensors.items()}
    network.load_state_dict(state, strict=False)  # all but the counters; `check` has been strict
    network.eval().requires_grad_(False)
