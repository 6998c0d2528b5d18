from __future__ import annotations

import pytest
import torch

from learning.clouds import add_noise, draw_points


def seeded(seed=0):
    return torch.Generator().manual_seed(seed)


def test_drawn_points_are_points_of_their_cloud_none_twice():
    clouds = torch.arange(2 * 50 * 3).reshape(2, 50, 3).float()
    drawn = draw_points(clouds, 20, seeded())
    for cloud, points in zip(clouds, drawn, strict=True):
        rows = [cloud.tolist().index(point) for point in points.tolist()]
        assert len(set(rows)) == 20
        assert rows != sorted(rows)


def test_all_points_is_a_permutation():
    clouds = torch.randn(3, 40, 3, generator=seeded())
    drawn = draw_points(clouds, 40, seeded(1))
    assert torch.equal(drawn.sort(dim=1).values, clouds.sort(dim=1).values)


def test_clouds_are_drawn_from_apart():
    clouds = torch.arange(50.0)[None, :, None].expand(4, 50, 3)
    drawn = draw_points(clouds, 25, seeded())
    assert len({tuple(rows) for rows in drawn[:, :, 0].tolist()}) == 4


def test_every_point_is_drawn_as_often():
    clouds = torch.arange(10.0)[None, :, None].expand(4000, 10, 3)
    counts = torch.bincount(draw_points(clouds, 3, seeded())[:, :, 0].long().flatten())
    # 4,000 times 3 of 10: a deviation of sqrt(4000 * 0.3 * 0.7) = 29
    assert (counts - 1200).abs().max() < 4 * 29


@pytest.mark.parametrize(("most", "clean_share"), [(0.1, 0.5), (0.12, 0.4), (3.0, 0.0)])
def test_noise_is_as_stated(most, clean_share):
    # what is added to zero is the noise
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


def test_noise_is_added_to_the_points():
    points = torch.randn(3, 20, 3, generator=seeded(1))
    alone = add_noise(torch.zeros(3, 20, 3), 0.1, 0.0, seeded())
    assert torch.equal(add_noise(points, 0.1, 0.0, seeded()), points + alone)
    assert torch.equal(add_noise(points, 0.1, 1.0, seeded()), points)
