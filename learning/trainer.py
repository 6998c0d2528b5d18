"""State, averages, mixed precision and optimiser steps that all trainers of networks share."""

from __future__ import annotations

import copy
import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import is_dataclass
from typing import Any, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from learning import checkpoint
from learning.processes import ONE, Processes

_NetworkT = TypeVar("_NetworkT", bound=nn.Module)
CPU = torch.device("cpu")


class NetworkTrainer:
    """A base of trainings, as `learning.training_loop` sees them; subclasses have a step.

    kind   of checkpoints
    batch  images, or clouds, of a step
    parts  networks, optimisers and the random generator: attributes, as a checkpoint names them
    kept   further attributes, tensors, that the next step depends on

    The configuration has at least `steps`, a `seed`, a `cadence`, and a `precision` where
    `autocast` is used. What is learned from are arrays, or networks, dataclasses, mappings and
    tuples of them.
    """

    kind: str
    batch: int
    parts: tuple[str, ...]
    kept: tuple[str, ...] = ("steps_done",)
    config: Any

    def __init__(
        self, learned: Any, config: Any, device: torch.device = CPU, processes: Processes = ONE
    ) -> None:
        self.learned, self.config, self.device = learned, config, device
        self.processes = processes
        self.random = processes.random(config.seed)
        self.steps_done = torch.zeros((), dtype=torch.int64)

    def take_step(self) -> dict[str, Tensor]:
        """Take one step of optimisation and return the losses by name.

        They are detached scalars of one device, under the same names in every step. To read a value
        would wait for the device: the loop does, and only for what is logged.
        """
        raise NotImplementedError

    def learning_rates(self, steps: int) -> str:
        """Return the rates of the first `steps` steps, in words for the card of the weights."""
        raise NotImplementedError

    def sheet(self) -> NDArray[np.uint8] | None:
        """Return an image [H, W, 3] of the training's progress, without changing it; or None."""
        return None

    def independent_steps(self, steps: int) -> int | None:
        """Return how many of `steps` steps are the same in a training of any length; None: all.

        A learning rate that falls at the end depends on where the end is.
        """
        return None

    def state(self) -> dict[str, Tensor]:
        """Return all tensors that the next step depends on."""
        packed = checkpoint.pack(**{name: getattr(self, name) for name in self.parts})
        return packed | {name: getattr(self, name) for name in self.kept}

    def restore(self, state: Mapping[str, Tensor]) -> None:
        """Restore what `state` has returned."""
        checkpoint.unpack(state, **{name: getattr(self, name) for name in self.parts})
        for name in self.kept:
            setattr(self, name, state[name].clone())

    def fingerprint(self) -> str:
        """Return a checksum of what is learned from, so that a run is not continued on other."""
        return hash_arrays(*_arrays(self.learned))

    def autocast(self) -> torch.autocast:
        """Return a context of mixed precision where the configuration asks for it."""
        enabled = self.config.precision == "bfloat16"
        return torch.autocast(self.device.type, torch.bfloat16, enabled=enabled)

    def minimise(
        self, loss: Tensor, optimizer: torch.optim.Optimizer, rate: float | None = None
    ) -> None:
        """Take one step of the optimiser with the mean gradients of all processes.

        rate  the learning rate of this step; None: that of the step before
        """
        groups = optimizer.param_groups
        optimizer.zero_grad()
        loss.backward()
        self.processes.average_gradients(p for group in groups for p in group["params"])
        if rate is not None:
            for group in groups:
                group["lr"] = rate
        optimizer.step()


class CooledTrainer(NetworkTrainer):
    """A trainer whose learning rate is constant, then falls to nothing over the last steps.

    The configuration has `learning_rate`, `steps` and `cool_down`, the number of these last steps.
    A `network` is trained by `adam`, and what is exported is its `average`.
    """

    def build(self, network: nn.Module) -> None:
        """Take the network to train, and make its average and its optimiser."""
        self.batch = self.config.batch
        self.network = network.to(self.device)
        self.average = averaged(self.network)
        rate = self.config.learning_rate
        self.adam = torch.optim.Adam(self.network.parameters(), lr=rate, fused=True)

    def learn(self, loss: Tensor) -> None:
        """Take a step of the network, and move the average."""
        self.minimise(loss, self.adam, self.rate(int(self.steps_done)))
        self.steps_done += 1
        update(self.average, self.network, self.config.ema_decay, int(self.steps_done))

    def rate(self, done: int) -> float:
        """Return the learning rate of the step after `done` steps."""
        left = self.config.steps - done
        return self.config.learning_rate * min(1.0, left / max(1, self.config.cool_down))

    def independent_steps(self, steps: int) -> int:
        """Return the number of steps before the last `cool_down`."""
        return max(0, steps - self.config.cool_down)

    def learning_rates(self, steps: int) -> str:
        """Return the whole schedule in words."""
        last = f"{self.rate(steps - 1):g} at step {steps}"
        constant = min(steps, self.config.steps - max(1, self.config.cool_down) + 1)
        if constant < 1:
            return f"falling linearly from {self.rate(0):g} at step 1 to {last}"
        rate = f"{self.config.learning_rate:g}"
        if constant == steps:
            return rate
        return f"{rate} up to step {constant}, then falling linearly to {last}"


def averaged(network: _NetworkT) -> _NetworkT:
    """Return a copy in evaluation mode, to be moved by `update`."""
    return copy.deepcopy(network).eval().requires_grad_(False)


@torch.no_grad()
def update(average: nn.Module, current: nn.Module, decay: float, step: int) -> None:
    """Move `average` towards `current`, weights and BatchNorm statistics, after `step` steps.

    The memory is shorter at the start, min(decay, (1 + step) / (10 + step)), so that the random
    weights that training began with are soon forgotten. Counters are copied.
    """
    decay = min(decay, (1 + step) / (10 + step))
    state = current.state_dict()
    for name, value in average.state_dict().items():
        if value.is_floating_point():
            value.lerp_(state[name], 1 - decay)
        else:
            value.copy_(state[name])


@torch.no_grad()
def take_statistics(current: nn.Module, average: nn.Module) -> None:
    """Make BatchNorms of `current`, in training mode, normalise by the statistics of `average`.

    A batch whose clouds all have few points normalises itself in training, but not at inference,
    where statistics are of all batches. Trained on to the end like that, splat-net lost .05 of SSIM
    at 512 points; what is trained last has to be what draws.
    """
    others = dict(average.named_modules())
    for name, module in current.named_modules():
        if isinstance(module, nn.BatchNorm2d):
            for buffer, other in zip(module.buffers(), others[name].buffers(), strict=True):
                buffer.copy_(other)
            module.eval()


def hash_arrays(*arrays: NDArray[Any]) -> str:
    """Return a fingerprint of training data."""
    digest = hashlib.sha256()
    for array in arrays:
        digest.update(f"{array.dtype}{array.shape}".encode())
        digest.update(np.ascontiguousarray(array).data)
    return digest.hexdigest()


def _arrays(learned: Any) -> Iterator[NDArray[Any]]:
    """Yield the arrays of data, in their order."""
    if isinstance(learned, nn.Module):
        learned = learned.state_dict()
    elif is_dataclass(learned):
        learned = vars(learned)
    if isinstance(learned, Mapping):
        learned = tuple(learned.values())
    if isinstance(learned, tuple):
        for part in learned:
            yield from _arrays(part)
    else:
        yield learned.cpu().numpy() if isinstance(learned, Tensor) else learned
