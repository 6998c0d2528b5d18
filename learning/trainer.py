"""The base of trainers of networks: state, averages, mixed precision and optimiser steps."""

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
    """A base class of trainers, with all that `learning.training_loop` calls but `take_step`.

    Subclasses define these attributes of the class:

    kind   the name of the training in its checkpoints
    batch  the number of images, or of clouds, in a step
    parts  the names of the attributes that are networks, optimisers or the random generator, whose
           state is saved in checkpoints
    kept   the names of further attributes in checkpoints: tensors that the next step depends on

    The constructor takes:

    learned    the data that are learned from: arrays, networks, or dataclasses, mappings and tuples
               of these
    config     the configuration, with at least `steps`, `seed` and `cadence`, and with `precision`
               where `autocast` is used
    device     the device of the networks
    processes  the processes that train together
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

        They are detached scalar tensors on one device, with the same names in every step. They are
        not read here, because that would wait for the device; the loop reads those that it logs.
        """
        raise NotImplementedError

    def learning_rates(self, steps: int) -> str:
        """Return the learning rates of the first `steps` steps in words, for the weights' card."""
        raise NotImplementedError

    def sheet(self) -> NDArray[np.uint8] | None:
        """Return an image [H, W, 3] of the training's progress, or None if it has none.

        This does not change the training.
        """
        return None

    def independent_steps(self, steps: int) -> int | None:
        """Return how many of a training's first steps are the same for any number of steps.

        Where the learning rate falls at the end, the last steps depend on where that is. None where
        no step depends on `steps`, the length of the training.
        """
        return None

    def state(self) -> dict[str, Tensor]:
        """Return all tensors that the next step depends on."""
        packed = checkpoint.pack(**{name: getattr(self, name) for name in self.parts})
        return packed | {name: getattr(self, name) for name in self.kept}

    def restore(self, state: Mapping[str, Tensor]) -> None:
        """Set the trainer to a state that `state` has returned."""
        checkpoint.unpack(state, **{name: getattr(self, name) for name in self.parts})
        for name in self.kept:
            setattr(self, name, state[name].clone())

    def fingerprint(self) -> str:
        """Return a SHA-256 of the data that are learned from.

        A training is not continued on data with another one.
        """
        return hash_arrays(*_arrays(self.learned))

    def autocast(self) -> torch.autocast:
        """Return a context of mixed precision, which does nothing for the precision "float32"."""
        enabled = self.config.precision == "bfloat16"
        return torch.autocast(self.device.type, torch.bfloat16, enabled=enabled)

    def minimise(
        self, loss: Tensor, optimizer: torch.optim.Optimizer, rate: float | None = None
    ) -> None:
        """Take one step of the optimiser with the mean gradients of all processes.

        rate  the learning rate of this step; None for that of the step before
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
    """A base class of trainers whose learning rate is constant and falls to 0 at the end.

    The configuration has `learning_rate`, `steps`, `cool_down` (the number of steps at the end over
    which the rate falls) and `ema_decay`. The optimiser `adam` trains the attribute `network`. The
    moving average of its weights, `average`, is exported.
    """

    def build(self, network: nn.Module) -> None:
        """Set the network that is trained, its average and its optimiser."""
        self.batch = self.config.batch
        self.network = network.to(self.device)
        self.average = averaged(self.network)
        rate = self.config.learning_rate
        self.adam = torch.optim.Adam(self.network.parameters(), lr=rate, fused=True)

    def learn(self, loss: Tensor) -> None:
        """Take a step of the network by a loss, and move the average."""
        self.minimise(loss, self.adam, self.rate(int(self.steps_done)))
        self.steps_done += 1
        update(self.average, self.network, self.config.ema_decay, int(self.steps_done))

    def rate(self, done: int) -> float:
        """Return the learning rate of the step that follows `done` steps."""
        left = self.config.steps - done
        return self.config.learning_rate * min(1.0, left / max(1, self.config.cool_down))

    def independent_steps(self, steps: int) -> int:
        """Return the number of steps before the last `cool_down`."""
        return max(0, steps - self.config.cool_down)

    def learning_rates(self, steps: int) -> str:
        """Return the learning rates of the first `steps` steps in words."""
        last = f"{self.rate(steps - 1):g} at step {steps}"
        constant = min(steps, self.config.steps - max(1, self.config.cool_down) + 1)
        if constant < 1:
            return f"falling linearly from {self.rate(0):g} at step 1 to {last}"
        rate = f"{self.config.learning_rate:g}"
        if constant == steps:
            return rate
        return f"{rate} up to step {constant}, then falling linearly to {last}"


def averaged(network: _NetworkT) -> _NetworkT:
    """Return a copy of a network in evaluation mode, to become the average that `update` moves."""
    return copy.deepcopy(network).eval().requires_grad_(False)


@torch.no_grad()
def update(average: nn.Module, current: nn.Module, decay: float, step: int) -> None:
    """Move the weights and BatchNorm statistics of `average` towards those of `current`.

    decay  the weight of the average; that of `current` is 1 - decay
    step   the number of steps taken so far. At the start of a training (1 + step) / (10 + step) is
           less than `decay` and used in its place, so that the random weights are soon forgotten

    The counters of BatchNorm, which are no floating-point numbers, are copied.
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
    """Make the BatchNorms of `current` normalise by the statistics of `average`, as at inference.

    In training BatchNorm usually normalises by the statistics of the batch, and all clouds of a
    batch have the same number of points. At inference it normalises by the statistics of all
    batches, which fit clouds with few points less well: a splat-net that was trained to the end
    with statistics of batches lost 0.05 of SSIM at 512 points. So the last steps train the network
    with the statistics that it will draw with.
    """
    others = dict(average.named_modules())
    for name, module in current.named_modules():
        if isinstance(module, nn.BatchNorm2d):
            for buffer, other in zip(module.buffers(), others[name].buffers(), strict=True):
                buffer.copy_(other)
            module.eval()


def hash_arrays(*arrays: NDArray[Any]) -> str:
    """Return a SHA-256 of the types, shapes and values of arrays."""
    digest = hashlib.sha256()
    for array in arrays:
        digest.update(f"{array.dtype}{array.shape}".encode())
        digest.update(np.ascontiguousarray(array).data)
    return digest.hexdigest()


def _arrays(learned: Any) -> Iterator[NDArray[Any]]:
    """Yield all arrays in training data as NumPy arrays, in the order of fields and entries."""
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
