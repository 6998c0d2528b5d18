from __future__ import annotations

import pytest
import torch
from torch import nn

from learning.averaging import update


def build(value):
    network = nn.Sequential(nn.Linear(2, 2), nn.BatchNorm1d(2)).requires_grad_(False)
    for tensor in network.state_dict().values():
        tensor.fill_(value)
    return network


@pytest.mark.parametrize(
    ("decay", "step", "kept"),
    [(0.5, 1000, 0.5), (0.998, 1, 2 / 11), (0.998, 90, 0.91), (0.998, 10**6, 0.998), (0.0, 5, 0.0)],
)
def test_what_is_kept_of_the_average(decay, step, kept):
    """min(decay, (1 + step) / (10 + step)) of it, and the rest of what is new."""
    average, current = build(3), build(5)
    update(average, current, decay, step)
    for key, value in average.state_dict().items():
        expected = 5 if key.endswith("num_batches_tracked") else 3 * kept + 5 * (1 - kept)
        torch.testing.assert_close(value.double(), torch.full_like(value.double(), expected),
                                   rtol=1e-6, atol=0)  # fmt: skip
    assert all((value == 5).all() for value in current.state_dict().values())


def test_an_average_of_equals_stays():
    average, current = build(3), build(3)
    for step in range(5):
        update(average, current, 0.9, step)
    assert all((value == 3).all() for value in average.state_dict().values())
