"""The configurations of the trainings of pc2pix; they load no PyTorch, as command lines need it."""

from __future__ import annotations

from dataclasses import dataclass

from data_prep.failures import BadInput
from learning.configuration import DEFAULT_CADENCE, Cadence, Precision
from pc2pix.model_config import LITE, ModelConfig


@dataclass(frozen=True)
class AutoencoderConfig:
    """The configuration, with the original's defaults but for width and number of steps.

    steps      the original trains 600 passes over each cloud (101,640 steps for its chairs)
    precision  bfloat16 is mixed precision: weights, BN statistics and the loss stay float32
    """

    model: ModelConfig = LITE
    steps: int = 10_000
    batch: int = 32
    learning_rate: float = 1e-4
    augment: bool = False
    precision: Precision = "float32"
    seed: int = 0
    cadence: Cadence = DEFAULT_CADENCE


@dataclass(frozen=True)
class GanConfig:
    """The configuration, with the paper's defaults but for width and number of steps.

    objective  a key of `pc2pix.losses.OBJECTIVES`
    steps      pairs of one discriminator and one generator step (chair: 406,560 in the original)
    warm_up    first steps that train one network alone: the generator by reconstruction (`paired`),
               or the discriminator, before a generator that starts from weights
    start      checksum of the weights that generator and encoder start from; None: random ones
    augment    encode clouds with fewer points and noise (`pc2pix.augment.DEGRADATION`)
    precision  bfloat16 is mixed precision: weights, spectral norms, BN statistics and losses stay
               float32
    """

    model: ModelConfig = LITE
    objective: str = "acgan-code"
    steps: int = 20_000
    warm_up: int = 0
    start: str | None = None
    batch: int = 32
    augment: bool = False
    generator_lr: float = 1e-4
    discriminator_lr: float = 2e-4
    ema_decay: float = 0.999
    precision: Precision = "float32"
    seed: int = 0
    cadence: Cadence = DEFAULT_CADENCE

    def __post_init__(self) -> None:
        from pc2pix.losses import OBJECTIVES

        if self.objective not in OBJECTIVES:
            raise BadInput(
                f"objective: unknown {self.objective!r}; choose one of {', '.join(OBJECTIVES)}"
            )
        paired = OBJECTIVES[self.objective].reconstruction_weight > 0
        if self.warm_up and not paired and self.start is None:
            raise BadInput(
                f"warm_up {self.warm_up}: objective {self.objective} has no reconstruction term to "
                "warm up with; use 0, the objective paired, or weights to start from"
            )


@dataclass(frozen=True)
class DecoderConfig:
    """The configuration of a decoder's training.

    weights        sha256 of the weights whose encoder it belongs to
    learning_rate  of Adam at first; at step t it is divided by sqrt(1 + t / 500), which
                   does not depend on how many steps there will be
    precision      bfloat16 is mixed precision: weights and the loss stay float32
    """

    weights: str
    model: ModelConfig
    steps: int = 3000
    batch: int = 32
    learning_rate: float = 2e-3
    precision: Precision = "float32"
    seed: int = 0
    cadence: Cadence = DEFAULT_CADENCE
