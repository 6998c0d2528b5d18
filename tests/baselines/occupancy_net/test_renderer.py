from __future__ import annotations

import numpy as np
import pytest
import torch

from baselines.occupancy_net.network import HALF_EXTENT, OccupancyConfig, OccupancyNet
from baselines.occupancy_net.renderer import MOST_POINTS, OccupancyNetRenderer
from data_prep.failures import StageFailure
from data_prep.scene import PointCloud
from learning.weights import NetworkWeights

SMALL = OccupancyConfig(resolution=8, widths=(4, 6), hidden=5, blocks=1)


class Ball(OccupancyNet):
    """A network that sees a ball of radius 0.5 in everything; it remembers the points."""

    def encode(self, points):
        self.seen = points
        return super().encode(points)

    def on_grid(self, planes):
        return self.at

    def at(self, nodes, cells):
        return 20 * (0.5 - (nodes.T * (2 / cells) - 1).mul(HALF_EXTENT).norm(dim=1))


def ball(level=0.5, network=None):
    made = network or Ball(SMALL)
    return OccupancyNetRenderer(NetworkWeights(made, {}, ""), level=level)


def test_the_surface_lies_at_the_level_in_grey():
    """The logit of 0.25 is -log 3: a twentieth of that farther out."""
    for level, radius in ((0.5, 0.5), (0.25, 0.5 + np.log(3) / 20)):
        state = ball(level).prepare(PointCloud(np.eye(3)))
        found = np.linalg.norm(state.mesh.vertices, axis=1)
        np.testing.assert_allclose(found, radius, rtol=0, atol=1e-3)
        assert state.notes == ()


def test_it_takes_each_point_in_sight_once_and_no_more_than_it_was_trained_on():
    points = np.random.default_rng(0).uniform(-1, 1, (MOST_POINTS + 1, 3)).astype(np.float32)
    renderer = ball()
    state = renderer.prepare(PointCloud(np.concatenate([points, points, [[0, 0, 9]]])))
    used = renderer.network.seen[0].numpy()
    assert len(used) == MOST_POINTS
    assert {tuple(p) for p in used} < {tuple(p) for p in points}
    far, fewer = state.notes
    assert far == f"input: 1 of {2 * len(points) + 1} points left out, they lie beyond the camera"
    assert fewer == f"input: {MOST_POINTS} of {len(points)} points used"


def test_failures_have_names():
    class Broken(Ball):
        def at(self, nodes, cells):
            return super().at(nodes, cells) * torch.nan

    class Empty(Ball):
        def at(self, nodes, cells):
            return super().at(nodes, cells) - 1e3

    few = PointCloud(np.eye(3))
    cases = (
        (ball(), PointCloud(np.full((5, 3), 9.0)), "input", "0 of 5 points are different"),
        (ball(), PointCloud([[0, 0, np.nan]]), "input", "1 of 1 points are not finite"),
        (ball(network=Broken(SMALL)), few, "occupancy", "values are not finite"),
        (ball(network=Empty(SMALL)), few, "marching-cubes", "no surface"),
    )
    for renderer, cloud, stage, problem in cases:
        with pytest.raises(StageFailure) as failure:
            renderer.prepare(cloud)
        assert failure.value.stage == stage
        assert problem in failure.value.problem
