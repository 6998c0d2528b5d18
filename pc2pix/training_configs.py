"""The configurations of the trainings of pc2pix, read by command lines, hence without PyTorch."""

from __future__ import annotations

from dataclasses import dataclass

from data_prep.failures import BadInput
from learning.configuration import DEFAULT_CADENCE, Cadence, Precision
from pc2pix.model_config import LITE, ModelConfig


@dataclass(frozen=True)
class AutoencoderConfig:
    """The configuration of the autoencoder's training.

    Defaults are those of the original, but for the width and the number of steps.

    steps      of the training; the original takes 101,640 for its chairs, 600 with each cloud
    augment    whether the encoder is given fewer points with noise (`pc2pix.augment.degrade`)
    precision  "bfloat16" means mixed precision: weights, BN statistics and the loss stay in float32
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
    """The configuration of the GAN's training.

    Defaults are those of the paper, but for the width and the number of steps.

    objective  a key of `pc2pix.losses.OBJECTIVES`
    steps      of the discriminator, each with one of the generator; the original takes 406,560 for
               its chairs
    warm_up    number of first steps that train one network alone. With the objective `paired` that
               is the generator, by reconstruction; with the others it is the discriminator, and the
               generator starts from weights
    start      sha256 of the weights that generator and encoder start from; None where they are
               random
    augment    whether clouds are encoded with fewer points and noise (`pc2pix.augment.DEGRADATION`)
    precision  "bfloat16" means mixed precision: weights, spectral norms, BN statistics and losses
               stay in float32

    Raises BadInput for an unknown objective, and for a warm-up that would train nothing.
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

    weights        sha256 of the weights whose encoder the decoder is for
    learning_rate  of Adam at the beginning; at step t it is divided by sqrt(1 + t / 500), which
                   does not depend on the number of steps
    precision      "bfloat16" means mixed precision: weights and the loss stay in float32
    """

    weights: str
    model: ModelConfig
    steps: int = 3000
    batch: int = 32
    learning_rate: float = 2e-3
    precision: Precision = "float32"
    seed: int = 0
    cadence: Cadence = DEFAULT_CADENCE
