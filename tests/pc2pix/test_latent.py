from __future__ import annotations

import numpy as np
import pytest
import torch

from learning.training_loop import seeded
from pc2pix.latent import add_difference, decode, interpolate
from pc2pix.model import Decoder
from tests.learning.trainings import TINY


@pytest.fixture
def codes():
    return torch.randn(3, 1, 7, generator=torch.Generator().manual_seed(0))


@pytest.mark.parametrize("positions", [2, 3, 8])
def test_a_path_has_its_ends_exactly_and_is_straight_and_evenly_spaced(codes, positions):
    start, end, _ = codes.double()
    start, end = start * 1e6, end / 3  # start + (end - start) would lose the digits of the end
    line = interpolate(start, end, positions)
    assert torch.equal(line[:1], start)
    assert torch.equal(line[-1:], end)
    shares = torch.arange(positions, dtype=torch.float64)[:, None] / (positions - 1)
    torch.testing.assert_close(line, start + shares * (end - start), rtol=0, atol=1e-9)


def test_sums(codes):
    a, _, c = codes
    assert torch.equal(add_difference(a, a, c), c)
    two, five, eleven = (torch.full((1, 2), float(n)) for n in (2, 5, 11))
    assert add_difference(eleven, five, two).tolist() == [[8.0, 8.0]]


def test_wrong_shapes(codes):
    a, b, c = codes
    with pytest.raises(ValueError, match="its 2 ends, got 1"):
        interpolate(a, b, 1)
    with pytest.raises(ValueError, match=r"end: expected a code \[1, d\], got shape \[7\]"):
        interpolate(a, b[0], 3)
    with pytest.raises(ValueError, match=r"different lengths: start \[1, 7\], end \[1, 5\]"):
        interpolate(a, b[:, :5], 3)
    with pytest.raises(ValueError, match=r"c: expected a code \[1, d\], got shape \[2, 7\]"):
        add_difference(a, b, torch.cat([c, c]))


def test_decoding():
    decoder = seeded(0, lambda: Decoder(TINY))
    both = torch.randn(2, 4, generator=torch.Generator().manual_seed(1))
    clouds = decode(decoder, both)
    assert clouds.shape == (2, 2048, 3)
    assert clouds.dtype == np.float32
    assert np.abs(clouds).max() < 1
    assert np.array_equal(decode(decoder, both[1:])[0], clouds[1])
