"""The rule by which the reference vectors' weights are drawn, applied to our networks."""

from __future__ import annotations

import numpy as np
import torch
from torch import nn

from pc2pix.model import Decoder, Discriminator, Encoder, Generator


def modules_in_fill_order(network: nn.Module) -> list[nn.Module]:
    """The layers of a network in the order in which the reference draws their weights."""
    match network:
        case Generator():
            blocks = [(b.bn1, b.conv1, b.bn2, b.conv2, b.shortcut) for b in network.blocks]
            return [network.dense, *(m for b in blocks for m in b), network.bn, network.conv]
        case Discriminator():
            all_blocks = [*network.blocks, network.last_block]
            blocks = [(b.conv1, b.conv2, b.shortcut) for b in all_blocks]
            heads = [network.code, network.real, network.elevation, network.azimuth]
            return [*(m for b in blocks for m in b), *network.code_hidden, *heads]
        case Encoder():
            order = []
            for stage, branches in enumerate(network.branches):
                order += [m for b in branches for m in (b.bn, b.conv)]
                if stage < len(network.down):
                    down = network.down[stage]
                    order += [network.compress[stage], down.bn, down.conv]
            return [*order, network.last.bn, network.last.conv, network.dense]
        case Decoder():
            return list(network.layers)
    raise TypeError(type(network))


def fill_by_reference_rule(network: nn.Module, seed: int, fill_order: list) -> None:
    """Draw all weights of `network` from one generator, checking every shape on the way."""
    rng = np.random.default_rng(seed)
    modules = modules_in_fill_order(network)
    assert len(modules) == len(fill_order)
    for module, (name, shape) in zip(modules, fill_order, strict=True):
        if isinstance(module, nn.BatchNorm1d | nn.BatchNorm2d):
            assert [module.num_features] == shape, name
            values = {
                "weight": 1 + 0.1 * rng.standard_normal(shape),
                "bias": 0.1 * rng.standard_normal(shape),
                "running_mean": 0.1 * rng.standard_normal(shape),
                "running_var": 1 + 0.2 * rng.random(shape),
            }
        else:
            kernel = rng.standard_normal(shape) / np.sqrt(np.prod(shape[:-1]))
            # Keras keeps (..., in, out), PyTorch (out, in, ...)
            axes = (len(shape) - 1, len(shape) - 2, *range(len(shape) - 2))
            values = {"weight": kernel.transpose(axes)}
            values["bias"] = 0.01 * rng.standard_normal(shape[-1])
            if hasattr(module, "u"):
                values["u"] = rng.standard_normal((1, shape[-1]))[0]
        with torch.no_grad():
            for key, value in values.items():
                target = getattr(module, key)
                assert target.shape == value.shape, (name, key)
                target.copy_(torch.from_numpy(value))
