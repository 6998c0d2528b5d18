"""Exponential moving averages of networks: what is exported, and makes the sample sheets."""

from __future__ import annotations

import torch
from torch import nn


@torch.no_grad()
def update(average: nn.Module, current: nn.Module, decay: float, step: int) -> None:
    """Move `average` towards `current`, weights and BatchNorm statistics, after `step` steps.

    The memory is shorter at the start, min(decay, (1 + step) / (10 + step)), so that the random
    weights that training began with are soon forgotten. Counters are copied.
    """
    decay = min(decay, (1 + step) / (10 + step))
    state = current.state_dict()
    for name, value in average.state_dict().items():
        if value.is_floating_point():
            value.lerp_(state[name], 1 - decay)
        else:
            value.copy_(state[name])
