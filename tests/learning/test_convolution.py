from __future__ import annotations

import copy
import itertools

import pytest
import torch
from torch import nn
from torch.nn import functional

from learning.convolution import Convolution, fold_normalisation
from tests.pc2pix.networks import live_in


@pytest.mark.filterwarnings("ignore:TF32 acceleration")  # of the context manager
@pytest.mark.parametrize("enabled", [False, True])
@pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16, torch.float64])
@pytest.mark.parametrize(("size", "stride", "padding"), [(3, 1, 1), (4, 2, 1), (1, 1, 0)])
def test_against_pytorchs_own(enabled, dtype, size, stride, padding):
    """Kernels are laid out for one size of image, and right for any other."""
    torch.manual_seed(0)
    kernel, bias = torch.randn(7, 5, size, size).double(), torch.randn(7).double()
    options = {"stride": stride, "padding": padding}
    shapes = ((1, 5, 6, 8), (4, 5, 16, 16), (2, 5, 2, 3))
    for shape, given, relu in itertools.product(shapes, (bias, None), (False, True)):
        with torch.backends.mkldnn.flags(enabled=enabled):
            conv = Convolution(kernel, given, shapes[0], dtype, relu=relu, **options)
        assert enabled or not conv.prepacked
        x = torch.randn(shape).to(dtype, memory_format=torch.channels_last)
        expected = functional.conv2d(x.double(), kernel, given, **options)
        expected = expected.relu() if relu else expected
        # up to 80 products, of values up to 16 together: float32 keeps 2**-20 of them; bfloat16
        # rounds kernels, and then values up to 64 to units of 1/4; float64 keeps 2**-49
        atol = {torch.float32: 45 * 2.0**-20, torch.bfloat16: 0.25}.get(dtype, 45 * 2.0**-49)
        torch.testing.assert_close(conv(x), expected.to(dtype), rtol=0, atol=atol)


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
