from __future__ import annotations

import pytest
import torch
from torch import nn

from learning.averaging import take_statistics, update


def build(value):
    network = nn.Sequential(nn.Linear(2, 2), nn.BatchNorm1d(2)).requires_grad_(False)
    for tensor in network.state_dict().values():
        tensor.fill_(value)
    return network


@pytest.mark.parametrize(
    ("decay", "step", "kept"),
    [(0.5, 1000, 0.5), (0.998, 1, 2 / 11), (0.998, 90, 0.91), (0.0, 5, 0.0)],
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


def test_networks_are_trained_as_they_draw():
    """BatchNorms normalise by the average's statistics; weights and statistics stay."""
    current = nn.Sequential(nn.Conv2d(1, 2, 1), nn.BatchNorm2d(2), nn.Dropout())
    average = nn.Sequential(nn.Conv2d(1, 2, 1), nn.BatchNorm2d(2), nn.Dropout())
    norm, averaged = current[1], average[1]
    norm.weight.data.fill_(3)
    averaged.running_mean.copy_(torch.tensor([1.0, -2.0]))
    averaged.running_var.copy_(torch.tensor([4.0, 0.25]))
    averaged.num_batches_tracked.fill_(7)
    norm.eps = averaged.eps = 0.0
    current.train()
    take_statistics(current, average)
    actual = norm(torch.tensor([[5.0], [5.0]]).T[..., None, None])  # one pixel of two channels
    torch.testing.assert_close(actual.flatten(), torch.tensor([3 * (5 - 1) / 2, 3 * (5 + 2) / 0.5]))
    assert norm.running_mean.tolist() == averaged.running_mean.tolist() == [1, -2]
    assert int(norm.num_batches_tracked) == 7
    assert norm.weight.requires_grad
    assert current[2].training
    assert not norm.training
