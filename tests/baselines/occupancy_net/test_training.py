from __future__ import annotations

import numpy as np
import torch

from baselines.occupancy_net.config import OccupancyNetConfig
from baselines.occupancy_net.train import OccupancyNetTrainer
from data_prep.datasets.occupancy_set import OccupancySet
from learning.clouds import MAX_NOISE, POINTS_SEEN
from tests.learning.trainings import CADENCE, SMALL_OCCUPANCY, make_occupancy


def build(data, **changes):
    defaults = {"network": SMALL_OCCUPANCY, "batch": 20, "cool_down": 2, "cadence": CADENCE}
    return OccupancyNetTrainer(data, OccupancyNetConfig(**{**defaults, **changes}))


def test_batches_are_mirrored_together_and_degraded_as_splat_net_s():
    """All points of object i are at (0.25, i, 0), and so are its places, which are inside."""
    where = np.array([[0.25, i, 0] for i in range(3)], np.float32)
    clouds, places = (np.repeat(where[:, None], n, axis=1) for n in (2048, 60))
    data = OccupancySet(clouds, places, np.ones((3, 60), bool))
    trainer = build(data)
    counts = set()
    for _ in range(12):
        points, places, inside = trainer._draw_batch()
        counts.add(points.shape[1])
        assert places.shape == (20, 60, 3)
        assert inside.shape == (20, 60)
        assert (inside == 1).all()
        assert set(places[:, 0, 0].tolist()) == {0.25, -0.25}
        noise = (points - places[:, :1]).flatten(1).std(dim=1)
        assert (noise == 0).any()
        assert 0.03 < noise.max() < 1.1 * MAX_NOISE
        torch.testing.assert_close(points.mean(dim=1), places[:, 0], rtol=0, atol=0.03)
    assert counts == set(POINTS_SEEN)
    points, places, _ = build(data, augment=False)._draw_batch()
    assert torch.equal(points, places[:, :1].expand(-1, 2048, -1))


def test_the_loss_is_the_cross_entropy_of_the_labels_of_the_network_before_the_step():
    trainer = build(make_occupancy(), batch=3)
    network = trainer.network
    state = trainer.random.get_state()
    points, places, inside = trainer._draw_batch()
    with torch.no_grad():
        chance = network(points, places).double().sigmoid()
    expected = -(inside * chance.log() + (1 - inside) * (1 - chance).log()).mean()
    trainer.random.set_state(state)
    losses = trainer.take_step()
    torch.testing.assert_close(losses["occupancy"].double(), expected, rtol=1e-5, atol=0)
    assert losses["wrong"] == ((chance > 0.5) != (inside > 0)).float().mean()
