"""A wider generator that draws the same images, to measure the cost of width alone.

Every channel becomes `times` equal ones, and every weight that reads a channel is shared out among
its copies at random, so that copies differ in what they feed but not in what they hold
(Net2WiderNet: Chen, Goodfellow and Shlens 2016, https://arxiv.org/abs/1511.05641, section 3.2).
"""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor, nn

from pc2pix.model import Generator


def widen(generator: Generator, times: int, seed: int = 0) -> Generator:
    """Return a generator `times` as wide, in evaluation mode, that draws the same images.

    Up to rounding: sums are of `times` as many terms. Inputs, the three channels of the image and
    the latent dimension stay what they are. Raises ValueError for `times` below 1, RuntimeError
    where the wider configuration does not have `times` the channels (its widths are rounded).
    """
    if times < 1:
        raise ValueError(f"times must be at least 1, got {times}")
    random = torch.Generator().manual_seed(seed)
    state = generator.state_dict()
    for name, layer in generator.named_modules():
        reads = 1 if name == "dense" else times
        writes = 1 if name == "conv" else times
        if isinstance(layer, nn.Linear | nn.Conv2d):
            shared = _share_out(layer.weight.detach().double(), reads, random)
            state[f"{name}.weight"] = shared.repeat_interleave(writes, dim=0)
            state[f"{name}.bias"] = state[f"{name}.bias"].repeat_interleave(writes)
        elif isinstance(layer, nn.BatchNorm2d):
            for part in ("weight", "bias", "running_mean", "running_var"):
                state[f"{name}.{part}"] = state[f"{name}.{part}"].repeat_interleave(times)
    wide = Generator(replace(generator.config, width=generator.config.width * times))
    wide.load_state_dict(state)
    return wide.eval().requires_grad_(False)


def _share_out(weight: Tensor, times: int, random: torch.Generator) -> Tensor:
    """Map [cout, cin, ...] to [cout, times * cin, ...]: copies of a channel get parts of it.

    The parts lie between half and one and a half of an equal share, before they are scaled to one.
    """
    parts = torch.rand((*weight.shape[:2], times), generator=random, dtype=torch.float64) + 0.5
    parts /= parts.sum(dim=2, keepdim=True)
    shared = weight[:, :, None] * parts.reshape(*parts.shape, *[1] * (weight.ndim - 2))
    return shared.flatten(1, 2)
