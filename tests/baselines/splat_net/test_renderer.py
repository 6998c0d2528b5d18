from __future__ import annotations

import numpy as np
import pytest
import torch

from baselines.splat_net import load
from baselines.splat_net.network import NetworkConfig, composite
from baselines.splat_net.projection import ALL_INPUTS, Inputs, cameras, project
from baselines.splat_net.renderer import SplatNetRenderer, views_at_once
from baselines.splat_net.surfels import HOPS, find_surfels, stack
from data_prep.failures import StageFailure
from data_prep.rendering.images import to_uint8
from data_prep.scene import PointCloud, View
from learning.weights import NetworkWeights

from .conftest import lived_in, make_cloud

VIEWS = [View(0, 0), View(90, 20), View(-180, -40)]
CONFIG = NetworkConfig(widths=(8, 12, 16, 20, 24), heads=("colour",))
# Sums of up to 9 x 24 float32 products in another order, through 20 layers: some 1e-6.
CLOSE = 1e-5


def build(inputs=ALL_INPUTS, **options):
    config = NetworkConfig(inputs, CONFIG.widths, CONFIG.heads)
    return SplatNetRenderer(NetworkWeights(lived_in(config), {}, "0" * 64), **options)


@pytest.fixture(scope="module")
def renderer():
    return build()


@pytest.fixture(scope="module")
def cloud():
    return PointCloud(make_cloud())


@pytest.mark.parametrize("size", [64, 128])
def test_images_are_the_networks(cloud, size):
    """Step by step: surfels, channels, network, composite."""
    renderer = build(size=size)
    network = renderer.weights.network
    surfels = stack([find_surfels(cloud.points)])
    channels = project(surfels, cameras(VIEWS), ALL_INPUTS, size)
    _, (expected,) = composite(network(channels), ("colour",))
    actual = renderer.draw(renderer.prepare(cloud), VIEWS)
    np.testing.assert_allclose(actual, expected.permute(0, 2, 3, 1), rtol=0, atol=CLOSE)


def test_where_no_point_is_seen_the_image_is_white():
    renderer = load("chair")
    away = PointCloud(make_cloud() + np.float32([0, 100, 0]))
    assert (to_uint8(renderer.draw(renderer.prepare(away), VIEWS)) == 255).all()


@pytest.mark.parametrize("normals", [False, True])
@pytest.mark.parametrize("flattened", [False, True])
def test_surfaces_are_found_where_a_channel_needs_them(cloud, normals, flattened):
    renderer = build(inputs=Inputs(normals=normals, flattened=flattened))
    state = renderer.prepare(cloud)
    assert state.normals.shape[-2] == (len(HOPS) if normals or flattened else 0)
    whole = stack([find_surfels(cloud.points)])
    assert renderer.draw(state, VIEWS).tobytes() == renderer.draw(whole, VIEWS).tobytes()


def test_few_views_of_large_clouds_are_seen_at_once(renderer, cloud):
    points = (2048, 2**19 // 5, 2**18, 2**19, 2**24)
    assert [views_at_once(count) for count in points] == [20, 5, 2, 1, 1]
    state, many = renderer.prepare(cloud), [*VIEWS] * 7
    images = renderer.draw(state, many)
    for i in range(len(VIEWS), len(many)):
        np.testing.assert_allclose(images[i], images[i % len(VIEWS)], rtol=0, atol=CLOSE)


@pytest.mark.parametrize("size", [0, -16, 8, 100])
def test_sizes_that_are_refused(size):
    with pytest.raises(ValueError, match=f"size {size}: give a multiple of 16 pixels"):
        build(size=size)


def test_images_that_are_not_finite_fail_by_name(cloud):
    renderer = build()
    state = renderer.prepare(cloud)
    renderer.engine.network.last.bias[0] = torch.nan
    with pytest.raises(StageFailure, match="gives an image that is not finite") as failure:
        renderer.draw(state, VIEWS)
    assert failure.value.stage == "draw"


@pytest.mark.parametrize(
    "points",
    [
        np.zeros((1, 3)),
        make_cloud(2),
        make_cloud(9),
        np.tile(make_cloud(1), (500, 1)),
        make_cloud(300) * [1, 1, 0],
        make_cloud(300) * [0, 1, 0],
        np.stack(np.mgrid[-8:9, -8:9, -8:9], axis=-1).reshape(-1, 3) / 16,
        make_cloud(300) * 1e-30,
        make_cloud(300) * 1e30,
        make_cloud(300) + np.array([1e6, 0, 0]),
        make_cloud(300) * 8,  # the camera stands among them
    ],
)
def test_odd_clouds_are_drawn(renderer, points):
    """Nothing has to be small; what is not in the image is not seen."""
    images = renderer.draw(renderer.prepare(PointCloud(points.astype(np.float32))), VIEWS)
    assert np.isfinite(images).all()
    assert images.min() >= 0
    assert images.max() <= 1
