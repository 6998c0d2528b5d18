"""Training at a growing resolution: images of 32, then 64, then 128 px (Karras et al. 2018).

At a lower resolution the generator leaves out its last blocks and the discriminator its first ones.
Layers that only the training has turn features into small images, and small images into features.
The next blocks are blended in, so that what is learned outlives them.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

from pc2pix.model import (
    DISCRIMINATOR_CHANNELS,
    GENERATOR_CHANNELS,
    Discriminator,
    DiscriminatorOutput,
    Generator,
    ModelConfig,
    SpectralConv2d,
)
from pc2pix.model_config import initialise

HALVINGS = 2  # of the side of an image at the start of a training
FADE_SHARE = 0.2  # of the steps of a resolution, over which its blocks are blended in


class Stage(NamedTuple):
    """The resolution of a step: 128 px halved `halvings` times, its blocks of weight `fade`.

    `steps_before` have been taken at this resolution.
    """

    halvings: int
    fade: float
    steps_before: int


def stage_after(steps_done: int, grow: int) -> Stage:
    """Return the stage of the next step where each lower resolution has `grow` steps; 0: none."""
    if grow == 0:
        return Stage(0, 1.0, steps_done)
    stages_done = min(steps_done // grow, HALVINGS)
    steps_before = steps_done - stages_done * grow
    fade = 1.0 if stages_done == 0 else min(1.0, (steps_before + 1) / (FADE_SHARE * grow))
    return Stage(HALVINGS - stages_done, fade, steps_before)


def shrink(images: Tensor, stage: Stage) -> Tensor:
    """Map images [B, 3, 128, 128] to those of the stage: means of squares of pixels."""
    return functional.avg_pool2d(images, 2**stage.halvings) if stage.halvings else images


class ToImage(nn.Module):
    """The last layers of a generator of lower resolution, as `Generator.last`."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.bn = nn.BatchNorm2d(channels, eps=2e-5, momentum=0.1)
        self.conv = nn.Conv2d(channels, 3, 3, padding=1)
        initialise(self)

    def forward(self, x: Tensor) -> Tensor:
        """Map [B, channels, H, W] to images [B, 3, H, W]."""
        return torch.tanh(self.conv(functional.relu(self.bn(x))))


def small_outputs(config: ModelConfig) -> nn.ModuleList:
    """Return the last layers of generators of 64 and of 32 px."""
    channels = GENERATOR_CHANNELS[-2 : -2 - HALVINGS : -1]
    return nn.ModuleList(ToImage(config.scaled(c)) for c in channels)


def small_inputs(config: ModelConfig) -> nn.ModuleList:
    """Return the first layers of discriminators of 64 and of 32 px."""
    inputs = nn.ModuleList(
        SpectralConv2d(3, config.scaled(c), 1) for c in DISCRIMINATOR_CHANNELS[:HALVINGS]
    )
    initialise(inputs)
    return inputs


def draw(
    generator: Generator, outputs: nn.ModuleList, stage: Stage, inputs: tuple[Tensor, ...]
) -> Tensor:
    """Return images of the stage, of inputs as `Generator` takes them."""
    ends = [generator.last, *outputs]
    x = before = generator.first(*inputs)
    for block in generator.blocks[: len(generator.blocks) - stage.halvings]:
        before, x = x, block(x)
    images = ends[stage.halvings](x)
    if stage.fade == 1.0:
        return images
    smaller = functional.interpolate(ends[stage.halvings + 1](before), scale_factor=2.0)
    return stage.fade * images + (1 - stage.fade) * smaller


def judge(
    discriminator: Discriminator, inputs: nn.ModuleList, stage: Stage, images: Tensor
) -> DiscriminatorOutput:
    """Judge images of the stage."""
    x, first = images, stage.halvings
    if first > 0:
        x = inputs[first - 1](images)
    if stage.fade < 1.0:
        smaller = inputs[first](functional.avg_pool2d(images, 2))
        x = stage.fade * discriminator.blocks[first](x) + (1 - stage.fade) * smaller
        first += 1
    return discriminator.judge_features(x, first)
