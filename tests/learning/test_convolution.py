from __future__ import annotations

import pytest
import torch
from torch.nn import functional

from learning import convolution
from learning.convolution import Convolution


@pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16])
@pytest.mark.parametrize(("size", "stride", "padding"), [(3, 1, 1), (4, 2, 1), (1, 1, 0)])
def test_prepacked_kernels_are_kernels(monkeypatch, dtype, size, stride, padding):
    torch.manual_seed(0)
    kernel, bias = torch.randn(7, 20, size, size).double(), torch.randn(7).double()
    x = torch.randn(3, 20, 8, 8).to(dtype, memory_format=torch.channels_last)
    like = (8, 20, 8, 8)
    fast = Convolution(kernel, bias, like, dtype, stride=stride, padding=padding)
    monkeypatch.setattr(convolution, "_prepacks", lambda weight: False)
    plain = Convolution(kernel, bias, like, dtype, stride=stride, padding=padding)
    assert not plain.prepacked
    # up to 320 products in another order; bfloat16 then rounds values up to 64 to units of 1/4
    atol = 1e-4 if dtype == torch.float32 else 0.25
    torch.testing.assert_close(fast(x), plain(x), rtol=0, atol=atol)


@pytest.mark.parametrize("prepacks", [False, True])
@pytest.mark.parametrize("relu", [False, True])
@pytest.mark.parametrize("shape", [(1, 5, 6, 8), (4, 5, 16, 16), (2, 5, 1, 3)])
def test_against_pytorchs_own_whatever_the_size(monkeypatch, prepacks, relu, shape):
    """Kernels are laid out for one size, and right for any other."""
    if not prepacks:
        monkeypatch.setattr(convolution, "_prepacks", lambda weight: False)
    torch.manual_seed(0)
    kernel, bias = torch.randn(7, 5, 3, 3).double(), torch.randn(7).double()
    for given in (bias, None):
        conv = Convolution(kernel, given, (1, 5, 6, 8), torch.float32, padding=1, relu=relu)
        x = torch.randn(shape).to(memory_format=torch.channels_last)
        expected = functional.conv2d(x.double(), kernel, given, padding=1)
        expected = expected.relu() if relu else expected
        assert (expected < 0).any() != relu
        # 45 products, of values up to 16 together: float32 keeps 2**-20 of them
        torch.testing.assert_close(conv(x), expected.float(), rtol=0, atol=45 * 2.0**-20)


def test_the_kernel_is_copied():
    kernel = torch.ones(1, 1, 1, 1, dtype=torch.float64)
    conv = Convolution(kernel, None, (1, 1, 2, 2), torch.float32)
    kernel.zero_()
    assert (conv(torch.ones(1, 1, 2, 2)) == 1).all()
