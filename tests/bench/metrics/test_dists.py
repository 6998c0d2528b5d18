"""DISTS by values of the published code; invariants and refusals are in `test_extreme_inputs`."""

from __future__ import annotations

import pytest
import torch

from bench.metrics.dists import dists, pooled
from tests.bench.metrics.test_lpips import PAIRS, disc

# By DISTS_pytorch 0.1 itself in float64 on the same weights, on 2026-11-25.
GOLDEN = {
    "white/black": 0.373687821513,
    "disc 30 grey 150/white": 0.378907931251,
    "ramp/noise 2": 0.507081203432,
}


@pytest.mark.parametrize("name", GOLDEN)
def test_values_of_the_published_code(name):
    a, b = (image[None] for image in PAIRS[name])
    assert dists(a, b)[0] == pytest.approx(GOLDEN[name], rel=0, abs=1e-7)
    assert dists(a, b, single=True)[0] == pytest.approx(GOLDEN[name], rel=0, abs=1e-5)


def test_pooling_by_hand():
    """One pixel of 4: a quarter of it counts half, beside it an eighth of 16, at a corner 1/16."""
    image = torch.zeros(1, 1, 4, 4, dtype=torch.float64)
    image[0, 0, 1, 2] = 4.0
    expected = torch.tensor([[0.0, 2.0], [0.0, 2.0]], dtype=torch.float64).sqrt()
    torch.testing.assert_close(pooled(image)[0, 0], expected, rtol=0, atol=1e-6)


def test_a_disc_moved_is_nearer_than_none():
    grey = disc(30, 150)[None]
    moved, absent = disc(30, 150, column=67)[None], disc(0, 255)[None]
    assert dists(grey, moved, single=True)[0] < 0.2 * dists(grey, absent, single=True)[0]
