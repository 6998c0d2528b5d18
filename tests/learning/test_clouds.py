from __future__ import annotations

import torch

from learning.clouds import add_noise, draw_points


def seeded(seed=0):
    return torch.Generator().manual_seed(seed)


def test_drawn_points_are_points_of_their_cloud_none_twice():
    clouds = torch.arange(4 * 50 * 3).reshape(4, 50, 3).float()
    drawn = draw_points(clouds, 25, seeded())
    orders = set()
    for cloud, points in zip(clouds, drawn, strict=True):
        rows = [cloud.tolist().index(point) for point in points.tolist()]
        assert len(set(rows)) == 25
        assert rows != sorted(rows)
        assert max(rows) >= 25, "not only the first"
        orders.add(tuple(rows))
    assert len(orders) == 4, "each cloud by an order of its own"
    whole = draw_points(clouds, 50, seeded(1))
    assert torch.equal(whole.sort(dim=1).values, clouds.sort(dim=1).values)


def test_noise_is_as_stated():
    # what is added to zero is the noise
    most, clean_share = 0.12, 0.4
    noise = add_noise(torch.zeros(2000, 500, 3), most, clean_share, seeded())
    sigma = noise.flatten(1).std(dim=1)
    clean = sigma == 0
    # 2,000 coin flips: 4 standard deviations are 0.045
    assert abs(clean.float().mean() - clean_share) < 0.045
    # a deviation estimated from 1,500 numbers is good to 1.8 %; 4 times that
    assert sigma.max() < most * 1.073
    # uniform in 0..most: the mean of 1,000 or more has a deviation of most / sqrt(12,000)
    assert abs(sigma[~clean].mean() - most / 2) < 4 * most / 12000**0.5
    assert abs((noise / most).mean()) < 4 / (3e6) ** 0.5
    points = torch.randn(2000, 500, 3, generator=seeded(1))
    assert torch.equal(add_noise(points, most, clean_share, seeded()), points + noise)
    assert torch.equal(add_noise(points, most, 1.0, seeded()), points)
