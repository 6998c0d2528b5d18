from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import nn

from baselines.splat_net.config import SplatNetConfig
from baselines.splat_net.network import SplatNet
from baselines.splat_net.train import SplatNetTrainer
from learning.configuration import Cadence
from learning.training_loop import train
from tests.learning.trainings import SMALL, make_surfaces
from tests.pc2pix.networks import live_in


def make_cloud(count=2048, seed=0):
    rng = np.random.default_rng(seed)
    return rng.uniform(-0.5, 0.5, (count, 3)).astype(np.float32)


def lived_in(config):
    """Return a network whose layers hand on as much as they are given."""
    torch.manual_seed(0)
    network = live_in(SplatNet(config))
    for module in network.modules():
        if isinstance(module, nn.Conv2d):
            nn.init.kaiming_normal_(module.weight, nonlinearity="relu")
    return network


@pytest.fixture(scope="session")
def data():
    return make_surfaces(views=4)


@pytest.fixture(scope="session")
def trained(data, tmp_path_factory):
    """The checkpoint of two steps."""
    config = SplatNetConfig(network=SMALL, steps=2, batch=4, cadence=Cadence(1, 2, 2))
    return train(SplatNetTrainer, data, config, tmp_path_factory.mktemp("trained"))
