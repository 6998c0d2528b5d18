"""Networks whose numbers are as unlike those of a fresh one as training could make them."""

from __future__ import annotations

import torch
from torch import nn


def live_in(network):
    """Return the network, ready to draw, with numbers of torch's global generator.

    In BatchNorms and biases no number is 0 or 1; some scales are negative.
    """
    network.eval().requires_grad_(False)
    for module in network.modules():
        if isinstance(module, nn.BatchNorm2d):
            module.running_mean.normal_(0, 0.3)
            module.running_var.uniform_(0.5, 2)
            module.weight.normal_(0.8, 0.4)
            module.bias.normal_(0, 0.3)
        elif isinstance(module, nn.Conv2d | nn.Linear) and module.bias is not None:
            module.bias.normal_(0, 0.1)
    return network


def drawn(generator, code, elevation01, azimuth01, noise=None):
    """Return the images of the generator as it was trained, as `pc2pix.engine` gives them."""
    count = len(elevation01)
    noise = torch.zeros(count, 128) if noise is None else noise
    with torch.no_grad():
        images = generator(noise, code.expand(count, -1), elevation01, azimuth01)
    return images.permute(0, 2, 3, 1) / 2 + 0.5
