from __future__ import annotations

import copy

import torch
from torch import nn

from learning.convolution import fold_normalisation
from tests.pc2pix.networks import live_in


def test_a_normalisation_behind_a_convolution_becomes_part_of_it():
    torch.manual_seed(0)
    inner = nn.Sequential(nn.Conv2d(4, 6, 3, bias=False), nn.BatchNorm2d(6), nn.ReLU())
    # the first and the last one follow no convolution
    network = live_in(nn.Sequential(nn.BatchNorm2d(4), inner, nn.BatchNorm2d(6)))
    x = torch.randn(2, 4, 8, 8)
    expected = copy.deepcopy(network).double()(x.double())
    fold_normalisation(network)
    layers = (network[0], inner[1], network[2])
    assert [isinstance(layer, nn.BatchNorm2d) for layer in layers] == [True, False, True]
    # 36 products of values up to 8, scaled by at most 2 / sqrt(0.5) three times: 2**-24 of each
    torch.testing.assert_close(network(x).double(), expected, rtol=0, atol=36 * 8 * 22 * 2**-24)
