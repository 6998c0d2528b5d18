from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import nn

from baselines.splat_net.network import NetworkConfig, SplatNet
from baselines.splat_net.train import SplatNetConfig, train_splat_net
from data_prep.training_set import SurfaceSet, TrainingSet
from learning.training_loop import Cadence

SMALL = NetworkConfig(widths=(4, 6, 8, 10, 12))


def make_cloud(count=2048, seed=0):
    rng = np.random.default_rng(seed)
    return rng.uniform(-0.5, 0.5, (count, 3)).astype(np.float32)


def lived_in(config):
    """A network in whose BatchNorms and biases no number is 0 or 1; some scales are negative.

    Its layers hand on as much as they are given, so that the first one is heard in the last.
    """
    torch.manual_seed(0)
    network = SplatNet(config).eval().requires_grad_(False)
    for module in network.modules():
        if isinstance(module, nn.BatchNorm2d):
            assert module.running_mean is not None
            assert module.running_var is not None
            module.running_mean.normal_(0, 0.3)
            module.running_var.uniform_(0.5, 2)
            module.weight.normal_(0.8, 0.4)
            module.bias.normal_(0, 0.3)
        elif isinstance(module, nn.Conv2d | nn.Linear):
            nn.init.kaiming_normal_(module.weight, nonlinearity="relu")
            if module.bias is not None:
                module.bias.normal_(0, 0.1)
    return network


def make_data(objects=3, views=4, seed=1):
    """Clouds, angles and pictures at random: nothing of one is in another."""
    rng = np.random.default_rng(seed)
    shape = (objects, views, 128, 128)
    seen = TrainingSet(
        images=rng.integers(0, 256, (*shape, 3), dtype=np.uint8),
        azimuth_deg=rng.uniform(-180, 180, shape[:2]),
        elevation_deg=rng.uniform(-40, 40, shape[:2]),
        clouds=rng.uniform(-0.5, 0.5, (objects, 2048, 3)).astype(np.float32),
    )
    return SurfaceSet(
        seen,
        coverage=rng.integers(0, 256, shape, dtype=np.uint8),
        grey=rng.integers(0, 256, shape, dtype=np.uint8),
    )


@pytest.fixture(scope="session")
def data():
    return make_data()


@pytest.fixture(scope="session")
def trained(data, tmp_path_factory):
    """The checkpoint of two steps."""
    torch.set_num_threads(1)
    config = SplatNetConfig(network=SMALL, steps=2, batch=4, cadence=Cadence(1, 2, 2))
    return train_splat_net(data, config, tmp_path_factory.mktemp("trained"))
