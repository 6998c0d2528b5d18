from __future__ import annotations

import numpy as np
import pytest
import torch

from baselines.neighbourhoods import NEIGHBOURS
from baselines.splat_net.surfels import FLATTENED, HOPS, Surfels, find_surfels, stack

from .conftest import make_cloud

ROUNDED = 2.0**-23  # a number below 2 in float32, off by half of its last digit, and as much again


def arrays(surfels):
    return {name: value.numpy() for name, value in vars(surfels).items()}


def test_against_all_pairs_and_ways_of_so_many_hops():
    """A point counts in a neighbourhood as often as ways lead to it."""
    actual = arrays(find_surfels(make_cloud(120)))
    assert {value.dtype for value in actual.values()} == {np.dtype(np.float32)}
    place = actual["points"].astype(np.float64)
    hop = np.zeros((120, 120), int)
    for i, p in enumerate(place):
        hop[i, np.argsort([np.linalg.norm(q - p) for q in place])[:NEIGHBOURS]] = 1
    for i, p in enumerate(place):
        for scale, hops in enumerate(HOPS):
            ways = np.linalg.matrix_power(hop, hops)[i]
            assert ways.sum() == NEIGHBOURS**hops
            values, vectors = np.linalg.eig(np.cov(place.T, bias=True, fweights=ways))
            least = np.argmin(values)
            assert abs(actual["variation"][i, scale] - values[least] / values.sum()) < ROUNDED
            # the smallest eigenvalues are 1e-3 apart or more: 1e-12 of an angle, in float64
            normal = vectors[:, least]
            assert abs(abs(actual["normals"][i, scale] @ normal) - 1) < 2 * ROUNDED
            if scale in FLATTENED:
                height = (p - np.average(place, axis=0, weights=ways)) @ normal
                flattened = actual["flattened"][i, FLATTENED.index(scale)]
                assert np.abs(flattened - (p - height * normal)).max() < ROUNDED


def test_an_edge_and_corners_by_hand():
    """Up to 10 points are all neighbours of each other, after any number of hops."""
    # two halves of planes that meet in the Z axis: x has variance 1/3 - 1/9, covariance with y -1/9
    edge = np.array([(x, y, z) for x, y in ((1, 0), (0, 1), (0, 0)) for z in (-2, 2)], np.float32)
    surfels = arrays(find_surfels(edge))
    bisector = np.array([1, 1, 0]) / 2**0.5
    np.testing.assert_allclose(np.abs(surfels["normals"] @ bisector), 1, rtol=0, atol=ROUNDED)
    # eigenvalues 1/9, 3/9 and 4
    np.testing.assert_allclose(surfels["variation"], 1 / 40, rtol=1e-6)
    cube = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)], np.float32)
    np.testing.assert_allclose(arrays(find_surfels(cube))["variation"], 1 / 3, rtol=1e-6)
    assert arrays(find_surfels(cube))["variation"].max() <= np.float32(1 / 3)


def test_points_alone_where_no_surface_is_asked_for():
    cloud = np.vstack([make_cloud(70), make_cloud(70)[::-2]])
    alone = find_surfels(cloud, surfaces=False)
    assert alone.points.numpy().tobytes() == find_surfels(cloud).points.numpy().tobytes()
    assert alone.normals.shape == alone.flattened.shape == (70, 0, 3)
    assert alone.variation.shape == (70, 0)
    assert stack([alone, find_surfels(cloud[:9], surfaces=False)]).points.shape == (2, 70, 3)


def check(surfels, count):
    assert len(surfels) == count
    assert all(np.isfinite(a).all() for a in arrays(surfels).values())
    lengths = np.linalg.norm(surfels.normals.numpy(), axis=2)
    np.testing.assert_allclose(lengths, 1, rtol=0, atol=1e-6)
    assert surfels.variation.min() >= 0
    assert surfels.variation.max() <= np.float32(1 / 3)


@pytest.mark.parametrize("count", [1, 2, 3, 10, 11])
def test_few_points_and_many_that_coincide(count):
    cloud = make_cloud(count)
    for repeated in (1, 5000):
        surfels = find_surfels(np.tile(cloud, (repeated, 1)))
        check(surfels, count)
        np.testing.assert_array_equal(surfels.points, np.unique(cloud, axis=0))
        if count <= 3:  # they lie in a plane
            assert surfels.variation.max() < 1e-12
            moved = surfels.flattened - surfels.points[:, None]
            assert moved.abs().max() < ROUNDED


def assert_alike(surfels, plain, scale=1.0):
    np.testing.assert_array_equal(surfels.points.numpy() / scale, plain.points)
    flattened = surfels.flattened.numpy() / scale
    np.testing.assert_allclose(flattened, plain.flattened, rtol=0, atol=ROUNDED)
    np.testing.assert_allclose(surfels.variation, plain.variation, rtol=0, atol=ROUNDED)
    along = (surfels.normals * plain.normals).sum(dim=2).abs()
    np.testing.assert_allclose(along, 1, rtol=0, atol=4 * ROUNDED)


@pytest.mark.parametrize("scale", [2.0**-100, 2.0**100])  # 1e-30 and 1e30
def test_units_do_not_matter(scale):
    cloud = make_cloud(200)
    scaled = find_surfels(cloud * np.float32(scale))
    check(scaled, 200)
    assert_alike(scaled, find_surfels(cloud), scale)


@pytest.mark.parametrize("far", [1e4, 3e38])
def test_one_outlier_spoils_nothing_but_its_neighbours(far):
    more = find_surfels(np.vstack([make_cloud(300), [[0, 0, far]]]).astype(np.float32))
    check(more, 301)
    # among the last to be sorted by X it is somewhere; it is nobody's neighbour
    kept = more.points.abs().amax(dim=1) < 1
    others = Surfels(**{name: value[kept] for name, value in vars(more).items()})
    assert_alike(others, find_surfels(make_cloud(300)))


def test_where_a_cloud_is_does_not_matter():
    # multiples of 1/32, which float32 has out there as well
    cloud = np.random.default_rng(0).integers(-32, 32, (300, 3)).astype(np.float32) / 32
    here, far_surfels = find_surfels(cloud), find_surfels(cloud + np.float32(2.0**16))
    np.testing.assert_allclose(far_surfels.variation, here.variation, rtol=0, atol=ROUNDED)
    cloud = cloud[:100] * np.finfo(np.float32).max  # the largest numbers there are
    check(find_surfels(cloud), len(np.unique(cloud, axis=0)))


def test_half_of_a_cloud_in_a_plane_while_denormals_are_flushed():
    """SciPy's balanced tree would overflow the stack and end the process."""
    cloud = np.random.default_rng(0).uniform(-1, 1, (100, 3)).astype(np.float32)
    cloud[:60, 0] = 0
    cloud[60:, 0] = 4 * abs(cloud[60:, 0])
    torch.set_flush_denormal(True)
    try:
        check(find_surfels(cloud), 100)
    finally:
        torch.set_flush_denormal(False)


def test_clouds_are_stacked_and_filled_up_with_their_last():
    parts = [find_surfels(make_cloud(count, count)) for count in (20, 17)]
    together = stack(parts)
    assert len(together) == 20
    for name, value in vars(together).items():
        assert torch.equal(value[0], vars(parts[0])[name])
        assert torch.equal(value[1, :17], vars(parts[1])[name])
        assert torch.equal(value[1, 17:], vars(parts[1])[name][-1:].expand_as(value[1, 17:]))
