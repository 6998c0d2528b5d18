from __future__ import annotations

import numpy as np
import pytest
import torch

from baselines.occupancy_net.level_set import level_set, sample_grid
from baselines.occupancy_net.network import HALF_EXTENT
from data_prep.failures import StageFailure
from data_prep.scene import NEUTRAL_GREY

CELL = 2 * HALF_EXTENT / 128
NOWHERE = torch.zeros(1, 3)


def surface(occupancy, points=NOWHERE, level=0.0):
    def at(nodes, cells):
        return occupancy(nodes.T * (2 * HALF_EXTENT / cells) - HALF_EXTENT)

    values = sample_grid(at, points, HALF_EXTENT, level)
    return level_set(values.numpy(), level, HALF_EXTENT)


def ball(radius, steepness=40.0, centre=(0.0, 0.0, 0.0)):
    middle = torch.tensor(centre)
    return lambda places: steepness * (radius - (places - middle).norm(dim=1))


@pytest.mark.parametrize("level", [0.0, -1.0])
def test_the_level_set_of_a_ball(level):
    """The logit is -1 at a distance of 1/40 from the ball's surface."""
    mesh = surface(ball(0.6, centre=(0.2, -0.1, 0.3)), level=level)
    radius = np.linalg.norm(mesh.vertices - (0.2, -0.1, 0.3), axis=1)
    # on straight lines between nodes the distance is off by at most CELL^2 / (8 * 0.6)
    np.testing.assert_allclose(radius, 0.6 - level / 40, rtol=0, atol=CELL**2 / 4.8 + 1e-5)
    assert (mesh.face_colors == NEUTRAL_GREY).all()
    a, b, c = (mesh.vertices[mesh.faces[:, i]].astype(np.float64) for i in range(3))
    volume = (a * np.cross(b, c)).sum() / 6  # above 0: faces turn outwards
    assert volume == pytest.approx(4 / 3 * np.pi * (0.6 - level / 40) ** 3, rel=1e-3)


def test_refined_where_it_matters_the_grid_gives_the_surface_of_all_its_nodes():
    asked = []

    def occupancy(places):
        asked.append(len(places))
        return 30 * (0.5 - (places * torch.tensor([1.0, 2.0, 0.7])).norm(dim=1))

    mesh = surface(occupancy)
    assert sum(asked) < 0.2 * 129**3
    side = torch.linspace(-HALF_EXTENT, HALF_EXTENT, 129)
    whole = occupancy(torch.cartesian_prod(side, side, side)).view(129, 129, 129)
    other = level_set(whole.numpy(), 0.0, HALF_EXTENT)
    np.testing.assert_allclose(mesh.vertices, other.vertices, rtol=0, atol=1e-5)
    np.testing.assert_array_equal(mesh.faces, other.faces)


def test_a_part_thinner_than_a_coarse_cell_is_found_by_its_points():
    """A rod of 1.5 cells across; the nodes of 32 cells a side pass it by."""
    across = torch.tensor([1.5, 2.5]) * CELL  # its middle, between nodes of the coarsest grid

    def rod(places):
        square = (places[:, :2] - across).abs().amax(dim=1)
        return torch.where(places[:, 2].abs() < 0.5, 1e3 * (0.75 * CELL - square), -1e3)

    with pytest.raises(StageFailure, match="no surface"):
        surface(rod, torch.full((1, 3), -1.0))
    points = torch.cat([across.expand(50, 2), torch.linspace(-0.5, 0.5, 50)[:, None]], dim=1)
    mesh = surface(rod, points)
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    np.testing.assert_allclose((high - low)[:2], 1.5 * CELL, rtol=0, atol=1e-4)
    np.testing.assert_allclose((high - low)[2], 1.0, rtol=0, atol=2 * CELL)


def test_what_reaches_the_edge_of_the_box_is_closed_there():
    mesh = surface(lambda places: places[:, 1] * 0 + 5.0)
    edges = np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    _, counts = np.unique(edges, axis=0, return_counts=True)
    assert (counts == 2).all()
    assert np.abs(mesh.vertices).max() < HALF_EXTENT


def test_nothing_inside_and_values_that_are_not_finite_fail_by_name():
    with pytest.raises(StageFailure) as failure:
        surface(lambda places: places[:, 0] * 0 - 2.0, level=-1.0)
    assert failure.value.stage == "marching-cubes"
    assert failure.value.problem == "no surface: no value is above -1"
    with pytest.raises(StageFailure) as failure:
        surface(lambda places: torch.where(places[:, 0] > 1, torch.nan, -2.0))
    assert failure.value.stage == "occupancy"
    side = np.linspace(-HALF_EXTENT, HALF_EXTENT, 33)
    x, y, z = np.meshgrid(side, side, side)
    asked = x**2 + y**2 + z**2 <= HALF_EXTENT**2 + 1e-6
    bad = asked & (x > 1)
    assert failure.value.problem == f"{bad.sum()} of {asked.sum()} values are not finite"
