"""Checkpoints of a training run: one safetensors file, replaced atomically.

The tensors hold networks, optimiser state and the state of the random generator; everything else is
JSON in the file's header. A process killed at any moment leaves the previous checkpoint whole.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from data_prep.failures import BadInput
from learning.weights import (
    read_safetensors,
    sub_state,
    understanding_header,
    write_atomically,
)

FORMAT = "pc2pix-checkpoint-1"
FILE_NAME = "checkpoint.safetensors"


def save(
    path: Path, kind: str, step: int, config: Mapping[str, Any], state: Mapping[str, Tensor]
) -> None:
    """Write the checkpoint of a run of `kind` after `step` steps."""
    header = {"format": FORMAT, "kind": kind, "step": str(step), "config": json.dumps(config)}
    write_atomically(path, state, header)


def load(path: Path, kind: str) -> tuple[dict[str, Tensor], int, dict[str, Any]]:
    """Return state, number of steps done and configuration.

    Raises BadInput for anything but a checkpoint of `kind`.
    """
    state, header = read_safetensors(path)
    identity = (header.get("format"), header.get("kind"))
    if identity != (FORMAT, kind):
        raise BadInput(
            f"{path}: expected a checkpoint ({FORMAT}, {kind}), found {identity}; "
            "choose another output directory"
        )
    with understanding_header(path, "choose another output directory"):
        step, config = int(header["step"]), json.loads(header["config"])
        if step < 0 or not isinstance(config, dict):
            raise ValueError(f"step {step}, {type(config).__name__} as configuration")
    return state, step, config


def pack(**parts: nn.Module | torch.optim.Optimizer | torch.Generator) -> dict[str, Tensor]:
    """Return all state of the named parts as one flat table of tensors."""
    state: dict[str, Tensor] = {}
    for name, part in parts.items():
        if isinstance(part, nn.Module):
            state |= {f"{name}.{key}": value for key, value in part.state_dict().items()}
        elif isinstance(part, torch.Generator):
            state[name] = part.get_state()
        else:
            for index, entry in part.state_dict()["state"].items():
                state |= {f"{name}.{index}.{key}": value for key, value in entry.items()}
    return state


def unpack(
    state: Mapping[str, Tensor], **parts: nn.Module | torch.optim.Optimizer | torch.Generator
) -> None:
    """Put back in place what `pack` took out."""
    for name, part in parts.items():
        if isinstance(part, torch.Generator):
            part.set_state(state[name])
        elif isinstance(part, nn.Module):
            part.load_state_dict(sub_state(state, name))
        else:
            _unpack_optimizer(sub_state(state, name), part)


def _unpack_optimizer(state: Mapping[str, Tensor], optimizer: torch.optim.Optimizer) -> None:
    parameters = [p for group in optimizer.param_groups for p in group["params"]]
    entries: dict[int, dict[str, Tensor]] = {}
    for key, value in state.items():
        index, _, field = key.partition(".")
        parameter = parameters[int(index)]
        if value.shape == parameter.shape and value.dim() > 0:
            # the parameter's memory layout, so that the arithmetic takes the same path as before
            value = torch.empty_like(parameter, requires_grad=False).copy_(value)
        entries.setdefault(int(index), {})[field] = value
    whole = {"state": entries, "param_groups": optimizer.state_dict()["param_groups"]}
    optimizer.load_state_dict(whole)


def all_finite(tensors: Iterable[Tensor]) -> bool:
    """Return whether no floating-point tensor holds NaN or infinity."""
    return all(bool(t.isfinite().all()) for t in tensors if t.is_floating_point())
