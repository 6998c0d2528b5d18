"""The base of the judging networks' trainings: a cosine schedule, and how they are run."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from bench.judges.answers import ELEVATION_UNIT_DEG
from data_prep.progress import step_progress
from learning.configuration import DEFAULT_CADENCE, Cadence
from learning.processes import connect, is_first
from learning.trainer import CPU, NetworkTrainer
from learning.training_loop import run


@dataclass(frozen=True)
class JudgeConfig:
    """The configuration that a resumed training has to share, beside its data."""

    steps: int
    seed: int
    cadence: Cadence = DEFAULT_CADENCE


class CosineTrainer(NetworkTrainer):
    """A trainer on the CPU whose learning rate falls from `peak` by a cosine to zero.

    Objects are drawn in random order, each once in an epoch; `order` has those that are left.
    """

    peak: float
    kept = ("order", "steps_done")
    config: JudgeConfig

    def __init__(self, learned: Any, config: JudgeConfig, batch: int) -> None:
        super().__init__(learned, config, CPU, connect(CPU))
        self.batch = batch
        self.order = torch.empty(0, dtype=torch.long)

    def independent_steps(self, steps: int) -> int:
        """Return 0: the cosine spans all steps."""
        return 0

    def learning_rates(self, steps: int) -> str:
        """Return the whole schedule in words."""
        return f"{self.peak:g} by a cosine to zero over {self.config.steps} steps"

    def rate(self, done: int) -> float:
        """Return the learning rate of the step after `done` steps."""
        return self.peak * (1 + math.cos(math.pi * done / self.config.steps)) / 2

    def train(self, folder: Path) -> None:
        """Take all steps, of which a training in `folder` may have taken some.

        Raises as `learning.training_loop.run`.
        """
        with step_progress(self.kind, quiet=not is_first()) as show:
            run(self, folder, show)


def view_answers(
    azimuth_deg: NDArray[np.float64], elevation_deg: NDArray[np.float64]
) -> NDArray[np.float32]:
    """Return the right answers [..., 3]: azimuth's sine and cosine, elevation over 40 degrees."""
    azimuth = np.radians(azimuth_deg)
    view = [np.sin(azimuth), np.cos(azimuth), elevation_deg / ELEVATION_UNIT_DEG]
    return np.stack(view, axis=-1).astype(np.float32)
