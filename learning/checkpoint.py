"""Checkpoints of a training: one safetensors file, which is replaced atomically.

Its tensors are those of the networks, of the optimisers and of the random generator; everything
else is JSON in the file's header. If the process is killed while it writes, the previous checkpoint
stays whole.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from data_prep.failures import BadInput
from learning.tensor_files import (
    read_safetensors,
    sub_state,
    understanding_header,
    write_atomically,
)

FORMAT = "pc2pix-checkpoint-1"  # of the files, in their headers
FILE_NAME = "checkpoint.safetensors"  # in the output directory of a training


def save(
    path: Path, kind: str, step: int, config: Mapping[str, Any], state: Mapping[str, Tensor]
) -> None:
    """Write the checkpoint of a training.

    kind    of the training, `NetworkTrainer.kind`
    step    number of steps taken
    config  of the training, as JSON has it
    state   tensors by name, as `pack` returns them
    """
    header = {"format": FORMAT, "kind": kind, "step": str(step), "config": json.dumps(config)}
    write_atomically(path, state, header)


def load(path: Path, kind: str) -> tuple[dict[str, Tensor], int, dict[str, Any]]:
    """Return state, number of steps taken and configuration of a checkpoint.

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
    """Return the whole state of the named parts as one dictionary of tensors, "PART.KEY"."""
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
    """Put the state that `pack` returned into the same parts."""
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
            # In the parameter's memory layout: in another, rounding errors could differ.
            value = torch.empty_like(parameter, requires_grad=False).copy_(value)
        entries.setdefault(int(index), {})[field] = value
    whole = {"state": entries, "param_groups": optimizer.state_dict()["param_groups"]}
    optimizer.load_state_dict(whole)


def all_finite(tensors: Iterable[Tensor]) -> bool:
    """Return whether no floating-point tensor has NaN or infinity in it."""
    return all(bool(t.isfinite().all()) for t in tensors if t.is_floating_point())
