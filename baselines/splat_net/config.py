"""The configuration of a training of splat-net, read by command lines, hence without PyTorch."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from data_prep.failures import BadInput
from learning.configuration import DEFAULT_CADENCE, Cadence, Precision

if TYPE_CHECKING:
    from baselines.splat_net.network import NetworkConfig

VIEWS_TOGETHER = 2  # views of the same cloud that a step draws


def _default() -> NetworkConfig:
    from baselines.splat_net.network import DEFAULT

    return DEFAULT


@dataclass(frozen=True)
class SplatNetConfig:
    """The configuration of a training.

    objective  a key of `baselines.splat_net.losses.OBJECTIVES`
    steps      of the whole training
    warm_up    number of first steps in which the judge of patches learns, but its verdict does not
               enter the loss of the network
    cool_down  number of last steps, in which the learning rate falls to 0, and BatchNorm normalises
               as it does at inference (`learning.trainer.take_statistics`)
    batch      images of a step, a multiple of VIEWS_TOGETHER
    augment    whether clouds are degraded: fewer points, and noise
    judge_lr   learning rate of the judge of patches
    ema_decay  decay of the average of the weights, which is what is exported
    start      sha256 of the weights that training starts from; None where they are random

    Raises BadInput for an unknown objective, an odd batch, and heads that are not trained together.
    """

    network: NetworkConfig = field(default_factory=_default)
    objective: str = "l1"
    steps: int = 8000
    warm_up: int = 0
    cool_down: int = 2000
    batch: int = 24
    augment: bool = True
    learning_rate: float = 2e-3
    judge_lr: float = 4e-4
    ema_decay: float = 0.998
    precision: Precision = "float32"
    seed: int = 0
    start: str | None = None
    cadence: Cadence = DEFAULT_CADENCE

    def __post_init__(self) -> None:
        from baselines.splat_net.losses import OBJECTIVES
        from baselines.splat_net.network import COLOUR_HEADS

        if self.objective not in OBJECTIVES:
            raise BadInput(
                f"objective: unknown {self.objective!r}; choose one of {', '.join(OBJECTIVES)}"
            )
        if self.batch % VIEWS_TOGETHER or self.batch < VIEWS_TOGETHER:
            raise BadInput(
                f"batch {self.batch}: {VIEWS_TOGETHER} views of a cloud are drawn together; use a "
                f"multiple of {VIEWS_TOGETHER}"
            )
        if self.network.heads not in COLOUR_HEADS.values():
            raise BadInput(
                f"heads {self.network.heads}: colours and grey are trained at once; use "
                f"{' or '.join(map(str, COLOUR_HEADS.values()))}"
            )
