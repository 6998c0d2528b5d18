from __future__ import annotations

import numpy as np
import pytest
import torch

from learning.training_loop import seeded
from pc2pix.latent import add_difference, decode, interpolate
from pc2pix.model import Decoder
from tests.learning.trainings import TINY

A, B, C = torch.randn(3, 1, 7, generator=torch.Generator().manual_seed(0))


@pytest.mark.parametrize("positions", [2, 8])
def test_a_path_has_its_ends_exactly_and_is_straight_and_evenly_spaced(positions):
    start, end = A.double() * 1e6, B.double() / 3  # start + (end - start) would lose digits
    line = interpolate(start, end, positions)
    assert torch.equal(line[:1], start)
    assert torch.equal(line[-1:], end)
    shares = torch.arange(positions, dtype=torch.float64)[:, None] / (positions - 1)
    torch.testing.assert_close(line, start + shares * (end - start), rtol=0, atol=1e-9)


def test_sums():
    assert torch.equal(add_difference(A, A, C), C)
    two, five, eleven = (torch.full((1, 2), float(n)) for n in (2, 5, 11))
    assert add_difference(eleven, five, two).tolist() == [[8.0, 8.0]]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: interpolate(A, B, 1), "its 2 ends, got 1"),
        (lambda: interpolate(A, B[0], 3), r"end: expected a code \[1, d\], got shape \[7\]"),
        (lambda: interpolate(A, B[:, :5], 3), r"lengths: start \[1, 7\], end \[1, 5\]"),
        (lambda: add_difference(A, B, torch.cat([C, C])), r"c: expected .*, got shape \[2, 7\]"),
    ],
)
def test_wrong_shapes(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def test_decoding():
    decoder = seeded(0, lambda: Decoder(TINY))
    both = torch.randn(2, 4, generator=torch.Generator().manual_seed(1))
    clouds = decode(decoder, both)
    assert (clouds.shape, clouds.dtype) == ((2, 2048, 3), np.float32)
    assert np.array_equal(decode(decoder, both[1:])[0], clouds[1])
