"""Checkpoints of a training run: one safetensors file, replaced atomically.

The tensors hold networks, optimiser state and the state of the random generator; everything else is
JSON in the file's header. A process killed at any moment leaves the previous checkpoint whole.
"""

from __future__ import annotations

import json
from collections.abc import Generator, Iterable, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import torch
from safetensors import safe_open
from safetensors.torch import save_file
from torch import Tensor, nn

from data_prep.failures import BadInput
from data_prep.untrusted import is_regular_file, open_file
from data_prep.whole_files import whole_file
from learning.weight_files import MOST_BYTES

FORMAT = "pc2pix-checkpoint-1"
FILE_NAME = "checkpoint.safetensors"
MOST_REASON = 120  # characters of a library's complaint


def write_atomically(path: Path, tensors: Mapping[str, Tensor], header: Mapping[str, str]) -> None:
    """Write a safetensors file, whole or not at all."""
    plain = {key: value.detach().cpu().contiguous() for key, value in tensors.items()}
    with whole_file(path) as new:
        save_file(plain, new, metadata=dict(header))


def read_safetensors(path: Path) -> tuple[dict[str, Tensor], dict[str, str]]:
    """Tensors (on the CPU) and header of a safetensors file.

    Raises BadInput where the file is missing, cut short, of another kind, or larger than
    `MOST_BYTES`. Nothing in it is executed, and no more memory taken than the file has bytes.
    """
    if not is_regular_file(path):
        raise BadInput(f"{path}: no such file; give the path of a safetensors file")
    with open_file(path, MOST_BYTES):
        pass
    try:
        with safe_open(path, framework="pt") as file:
            header = dict(file.metadata() or {})
            return {key: file.get_tensor(key) for key in file.keys()}, header  # noqa: SIM118
    except Exception as error:  # whatever safetensors and torch raise for a type or shape
        reason = (str(error).splitlines() or [type(error).__name__])[0][:MOST_REASON]
        raise BadInput(
            f"{path}: not a whole safetensors file ({reason}); fetch or write it again"
        ) from None


def read_weights(
    path: Path, expected: str, remedy: str
) -> tuple[dict[str, Tensor], dict[str, str]]:
    """As `read_safetensors`, of exported weights: their header names the format `expected`.

    Raises BadInput, with the `remedy`, also where it names another.
    """
    tensors, header = read_safetensors(path)
    if header.get("format") != expected:
        raise BadInput(
            f"{path}: expected format {expected!r} in the header, found {header.get('format')!r}; "
            f"{remedy}"
        )
    return tensors, header


@contextmanager
def understanding_header(path: Path, remedy: str) -> Generator[None]:
    """What is raised inside by a header that lacks something, or says something else than it
    should, becomes BadInput with the `remedy`."""
    try:
        yield
    except (AttributeError, KeyError, TypeError, ValueError, RecursionError) as error:
        raise BadInput(f"{path}: its header cannot be read ({error!r}); {remedy}") from None


def save(
    path: Path, kind: str, step: int, config: Mapping[str, Any], state: Mapping[str, Tensor]
) -> None:
    """Write the checkpoint of a run of `kind` after `step` steps."""
    header = {"format": FORMAT, "kind": kind, "step": str(step), "config": json.dumps(config)}
    write_atomically(path, state, header)


def load(path: Path, kind: str) -> tuple[dict[str, Tensor], int, dict[str, Any]]:
    """State, number of steps done and configuration. Raises BadInput for anything else."""
    state, header = read_safetensors(path)
    found = (header.get("format"), header.get("kind"))
    if found != (FORMAT, kind):
        raise BadInput(
            f"{path}: expected a checkpoint ({FORMAT}, {kind}), found {found}; "
            "choose another output directory"
        )
    with understanding_header(path, "choose another output directory"):
        step, config = int(header["step"]), json.loads(header["config"])
        if step < 0 or not isinstance(config, dict):
            raise ValueError(f"step {step}, {type(config).__name__} as configuration")
    return state, step, config


def pack(**parts: nn.Module | torch.optim.Optimizer | torch.Generator) -> dict[str, Tensor]:
    """All state of the named parts as one flat table of tensors."""
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
    """Put back what `pack` took out, in place."""
    for name, part in parts.items():
        if isinstance(part, torch.Generator):
            part.set_state(state[name])
        elif isinstance(part, nn.Module):
            part.load_state_dict(sub_state(state, name))
        else:
            _unpack_optimizer(sub_state(state, name), part)


def sub_state(state: Mapping[str, Tensor], name: str) -> dict[str, Tensor]:
    """The entries below `name.`, without that prefix."""
    prefix = f"{name}."
    return {key.removeprefix(prefix): v for key, v in state.items() if key.startswith(prefix)}


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


def training_header(config: Mapping[str, Any], step: int, apart: Iterable[str]) -> str:
    """How weights were trained, as JSON for their file's header: the configuration, and the steps
    that were taken. Left out are the keys `apart`, which the header has of their own, and what
    says only how often something was written."""
    left_out = {*apart, "cadence"}
    kept = {key: value for key, value in config.items() if key not in left_out}
    return json.dumps(kept | {"steps": step})


def halved(tensors: Mapping[str, Tensor], source: Path, remedy: str) -> dict[str, Tensor]:
    """Kernels in float16, everything of one dimension as it is: how weights are exported.

    Raises BadInput, naming the checkpoint `source` and the `remedy`, where a value does not fit.
    """
    stored = {key: value.half() if value.dim() > 1 else value for key, value in tensors.items()}
    for key, value in stored.items():
        if not value.isfinite().all():
            raise BadInput(
                f"{source}: {key} reaches {tensors[key].abs().max():g}, beyond float16; {remedy}"
            )
    return stored


def all_finite(tensors: Iterable[Tensor]) -> bool:
    """Whether no floating-point tensor holds NaN or infinity."""
    return all(bool(t.isfinite().all()) for t in tensors if t.is_floating_point())
