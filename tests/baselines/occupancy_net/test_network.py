from __future__ import annotations

import pytest
import torch

from baselines.occupancy_net.network import (
    AXES,
    HALF_EXTENT,
    Cells,
    OccupancyConfig,
    OccupancyNet,
)
from learning.training_loop import seeded

SMALL = OccupancyConfig(resolution=16, widths=(6, 8, 10), hidden=7, blocks=2)


def network(config=SMALL):
    """A network whose layers hand on what they are given: no weight is zero."""

    def build():
        made = OccupancyNet(config)
        for parameter in made.parameters():
            torch.nn.init.normal_(parameter, std=0.3)
        return made.eval().requires_grad_(False)

    return seeded(0, build)


def random(*shape, seed=0):
    return torch.rand(shape, generator=torch.Generator().manual_seed(seed)) * 2 - 1


@pytest.mark.parametrize("plane", range(3))
def test_cells_have_the_mean_of_their_points(plane):
    """Two points in one cell of a plane, one in another, one beyond the edge."""
    u, v = AXES[plane]
    step = 2 * HALF_EXTENT / 4
    points = torch.zeros(1, 4, 3)
    for row, (i, j) in enumerate([(0.1, 2.2), (0.9, 2.7), (3.5, 0.5), (9.0, 1.5)]):
        points[0, row, u], points[0, row, v] = i * step - HALF_EXTENT, j * step - HALF_EXTENT
    cells = Cells(points, 4)
    means = cells.means(torch.tensor([[1.0], [3.0], [5.0], [7.0]])).view(3, 4, 4)[plane]
    expected = torch.zeros(4, 4)  # rows along the second axis of the plane
    expected[2, 0], expected[0, 3], expected[1, 3] = 2.0, 5.0, 7.0
    torch.testing.assert_close(means, expected)
    assert cells.counts.view(3, 4, 4)[plane, 2, 0] == 2


@pytest.mark.parametrize("axis", range(3))
def test_a_place_sees_the_cells_that_its_points_are_in(axis):
    """Planes of one cell each that is not zero: places there, and no others, see it."""
    net = network()
    resolution = SMALL.resolution
    for plane, (u, v) in enumerate(AXES):
        planes = torch.zeros(3, 6, resolution, resolution)
        planes[plane, :, 11, 4] = 5.0  # row 11 along v, column 4 along u
        at = torch.full((1, 4, 3), 0.9)
        centre = [(4.5 / 8 - 1) * HALF_EXTENT, (11.5 / 8 - 1) * HALF_EXTENT]
        at[0, :, u], at[0, :, v] = centre[0], centre[1]
        at[0, 1, u] += 2.1 * HALF_EXTENT / 8
        at[0, 2, v] -= 2.1 * HALF_EXTENT / 8
        other = ({0, 1, 2} - {u, v}).pop()
        at[0, 3, other] = -0.3
        changed = (net.occupancy(planes, at) - net.occupancy(planes * 0, at))[0].abs() > 1e-3
        assert changed.tolist() == [True, False, False, True]
        if axis == plane:
            assert net.occupancy(planes, at).shape == (1, 4)


@pytest.mark.parametrize("cells", [32, 64, 128])
def test_on_the_nodes_of_a_grid_it_is_what_it_is_at_their_places(cells):
    """Both are computed in double precision, where sums in another order hardly differ."""
    net = network().double()
    planes = net.encode(random(1, 300, 3).double())
    nodes = torch.randint(cells + 1, (3, 5000), generator=torch.Generator().manual_seed(1))
    nodes[:, :8] = torch.cartesian_prod(*[torch.tensor([0, cells])] * 3).T
    places = nodes.T.double() * (2 * HALF_EXTENT / cells) - HALF_EXTENT
    expected = net.occupancy(planes, places[None])[0]
    torch.testing.assert_close(net.on_grid(planes)(nodes, cells), expected, rtol=1e-9, atol=1e-9)


def test_logits_depend_on_the_whole_cloud_through_the_code():
    """Far from both places, a point more changes the answer, though little else does."""
    net, points = network(), torch.full((1, 20, 3), -0.9)
    places = torch.full((1, 1, 3), 0.9)
    moved = points.clone()
    moved[0, 0] = torch.tensor([-0.9, -0.9, -0.5])
    assert not torch.equal(net(points, places), net(moved, places))
