"""The configuration of a training; it loads no PyTorch, as command lines need it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from learning.configuration import DEFAULT_CADENCE, Cadence, Precision

if TYPE_CHECKING:
    from baselines.occupancy_net.network import OccupancyConfig


def _default() -> OccupancyConfig:
    from baselines.occupancy_net.network import DEFAULT

    return DEFAULT


@dataclass(frozen=True)
class OccupancyNetConfig:
    """The configuration of a training.

    cool_down  last steps, over which the learning rate falls to nothing
    batch      clouds a step
    augment    fewer points and noise; without it every cloud is seen whole and clean
    """

    network: OccupancyConfig = field(default_factory=_default)
    steps: int = 8000
    cool_down: int = 3000
    batch: int = 6
    augment: bool = True
    learning_rate: float = 1e-3
    ema_decay: float = 0.998
    precision: Precision = "float32"
    seed: int = 0
    cadence: Cadence = DEFAULT_CADENCE
