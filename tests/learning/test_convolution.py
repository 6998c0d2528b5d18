from __future__ import annotations

import itertools

import pytest
import torch
from torch.nn import functional

from learning import convolution
from learning.convolution import Convolution


@pytest.mark.parametrize("prepacks", [False, True])
@pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16])
@pytest.mark.parametrize(("size", "stride", "padding"), [(3, 1, 1), (4, 2, 1), (1, 1, 0)])
def test_against_pytorchs_own(monkeypatch, prepacks, dtype, size, stride, padding):
    """Kernels are laid out for one size of image, and right for any other."""
    if not prepacks:
        monkeypatch.setattr(convolution, "_prepacks", lambda weight: False)
    torch.manual_seed(0)
    kernel, bias = torch.randn(7, 5, size, size).double(), torch.randn(7).double()
    options = {"stride": stride, "padding": padding}
    shapes = ((1, 5, 6, 8), (4, 5, 16, 16), (2, 5, 2, 3))
    for shape, given, relu in itertools.product(shapes, (bias, None), (False, True)):
        conv = Convolution(kernel, given, shapes[0], dtype, relu=relu, **options)
        assert prepacks or not conv.prepacked
        x = torch.randn(shape).to(dtype, memory_format=torch.channels_last)
        expected = functional.conv2d(x.double(), kernel, given, **options)
        expected = expected.relu() if relu else expected
        # up to 80 products, of values up to 16 together: float32 keeps 2**-20 of them; bfloat16
        # rounds kernels, and then values up to 64 to units of 1/4
        atol = 45 * 2.0**-20 if dtype == torch.float32 else 0.25
        torch.testing.assert_close(conv(x), expected.to(dtype), rtol=0, atol=atol)


def test_the_kernel_is_copied():
    kernel = torch.ones(1, 1, 1, 1, dtype=torch.float64)
    conv = Convolution(kernel, None, (1, 1, 2, 2), torch.float32)
    kernel.zero_()
    assert (conv(torch.ones(1, 1, 2, 2)) == 1).all()
