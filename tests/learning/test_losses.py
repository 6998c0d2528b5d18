"""The parts that all trainings share beside their loop: averages, clouds, losses, and their log."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import nn

from learning import loss_log
from learning.clouds import add_noise, draw_points
from learning.image_losses import structural_similarity
from learning.loss_log import LossLog
from learning.trainer import update


def build(value):
    network = nn.Sequential(nn.Linear(2, 2), nn.BatchNorm1d(2)).requires_grad_(False)
    for tensor in network.state_dict().values():
        tensor.fill_(value)
    return network


@pytest.mark.parametrize(
    ("decay", "step", "kept"), [(0.5, 1000, 0.5), (0.998, 1, 2 / 11), (0.998, 90, 0.91)]
)
def test_what_is_kept_of_the_average(decay, step, kept):
    """min(decay, (1 + step) / (10 + step)) of it, and the rest of what is new."""
    average, current = build(3), build(5)
    update(average, current, decay, step)
    for key, value in average.state_dict().items():
        expected = 5 if key.endswith("num_batches_tracked") else 3 * kept + 5 * (1 - kept)
        assert value.double().flatten().tolist() == pytest.approx([expected] * value.numel())
    assert all((value == 5).all() for value in current.state_dict().values())


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


def images(count=2, size=40):
    a = torch.rand(count, 3, size, size + 6, generator=seeded(), dtype=torch.float64)
    return a, 0.6 * a + 0.4 * torch.rand(a.shape, generator=seeded(1), dtype=torch.float64)


def test_structural_similarity_is_scikit_images_at_every_second_window():
    from skimage.metrics import structural_similarity as reference

    a, b = images()
    expected = []
    for first, other in zip(a.numpy(), b.numpy(), strict=True):
        _, full = reference(
            first, other, data_range=1, channel_axis=0, gaussian_weights=True, sigma=1.5,
            use_sample_covariance=False, full=True,
        )  # fmt: skip
        expected.append(full[:, 5:-5:2, 5:-5:2].mean())
    # the windows' weights are float32 here
    assert abs(structural_similarity(a, b).item() - np.mean(expected)) < 1e-6


def test_structural_similarity_has_the_gradient_of_finite_differences():
    a, b = images(1, 13)
    assert torch.autograd.gradcheck(lambda x: structural_similarity(x, b), a.requires_grad_())


def test_the_log_keeps_the_whole_rows_up_to_a_step(tmp_path):
    path = tmp_path / loss_log.FILE_NAME
    log = LossLog(path, 0)
    log.add(1000, {"a": 1.5, "b": -2.0})
    log.add(2000, {"a": 1e-7, "b": 0.0})
    assert path.read_text() == "step,a,b\n1000,1.5,-2\n2000,1e-07,0\n"
    LossLog(path, 1000).add(1500, {"a": 1.0, "b": 2.0})
    assert path.read_text() == "step,a,b\n1000,1.5,-2\n1500,1,2\n"
    for cut in ("1", "12", "1230,0.5", ""):  # of "1230,0.5,0.25"
        path.write_text(f"step,a,b\n1000,1,2\n{cut}")
        LossLog(path, 1200)
        assert path.read_text() == "step,a,b\n1000,1,2\n"
