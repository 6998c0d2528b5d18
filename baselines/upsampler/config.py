"""The configuration of a training. It imports no PyTorch, because command lines read it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from learning.configuration import DEFAULT_CADENCE, Cadence, Precision

if TYPE_CHECKING:
    from baselines.upsampler.network import UpsamplerConfig


def _default() -> UpsamplerConfig:
    from baselines.upsampler.network import DEFAULT

    return DEFAULT


@dataclass(frozen=True)
class UpsamplerTrainingConfig:
    """The configuration of a training.

    cool_down  last steps, over which the learning rate falls to nothing
    batch      clouds a step
    """

    network: UpsamplerConfig = field(default_factory=_default)
    steps: int = 100_000
    cool_down: int = 4000
    batch: int = 2
    learning_rate: float = 3e-3
    ema_decay: float = 0.998
    precision: Precision = "float32"
    seed: int = 0
    cadence: Cadence = DEFAULT_CADENCE
