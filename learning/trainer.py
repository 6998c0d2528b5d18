"""State, mixed precision and optimiser steps that all trainers of networks share."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from learning import checkpoint
from learning.processes import ONE, Processes

Part = nn.Module | torch.optim.Optimizer | torch.Generator


class NetworkTrainer:
    """A base of `learning.training_loop.Trainer`; subclasses add step, parts and learning rates.

    kept  attributes, tensors, that are part of the state beside the parts

    The configuration has at least a `seed`, and a `precision` where `autocast` is used.
    """

    kept: tuple[str, ...] = ("steps_done",)
    kind: str
    batch: int
    config: Any

    def __init__(self, config: Any, device: torch.device, processes: Processes = ONE) -> None:
        self.config, self.device, self.processes = config, device, processes
        self.random = processes.random(config.seed)
        self.steps_done = torch.zeros((), dtype=torch.int64)

    def parts(self) -> dict[str, Part]:
        """Return networks, optimisers and the random generator, by their names in a checkpoint."""
        raise NotImplementedError

    def take_step(self) -> dict[str, Tensor]:
        """Take one step of optimisation and return the losses by name."""
        raise NotImplementedError

    def state(self) -> dict[str, Tensor]:
        """Return all tensors that the next step depends on."""
        return checkpoint.pack(**self.parts()) | {name: getattr(self, name) for name in self.kept}

    def restore(self, state: Mapping[str, Tensor]) -> None:
        """Restore what `state` has returned."""
        checkpoint.unpack(state, **self.parts())
        for name in self.kept:
            setattr(self, name, state[name].clone())

    def independent_steps(self, steps: int) -> int | None:
        """Return None, for all: the learning rate does not depend on the training's end."""
        return None

    def sheet(self) -> NDArray[np.uint8] | None:
        """Return None, for no sheet."""
        return None

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
    """

    def steps_left(self) -> int:
        """Return how many steps are still to be taken."""
        return self.config.steps - int(self.steps_done)

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
