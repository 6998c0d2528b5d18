"""Networks whose numbers are as unlike those of a fresh one as training could make them."""

from __future__ import annotations

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
