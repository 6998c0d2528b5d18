from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from baselines.fused_net.renderer import FusedNetRenderer
from baselines.fused_net.weights import MESHES
from baselines.splat_net.network import SplatNet
from baselines.splat_net.projection import Projection, cameras
from baselines.splat_net.renderer import SplatNetRenderer
from baselines.splat_net.surfels import find_surfels, stack
from data_prep.clouds.sampling import sample_surface
from data_prep.datasets.registry import ProceduralObject
from data_prep.rendering.mesh import draw_mesh
from data_prep.rendering.raycast import surface_maps
from data_prep.scene import NEUTRAL_GREY, PointCloud, View, in_one_colour
from learning.weights import NetworkWeights

from .conftest import Failing, Truth, fused, network

VIEWS = [View(20, 10), View(-100, -30), View(0, 80)]


def without_meshes(net):
    """The splat-net that has the other weights of a fused network."""
    inputs = replace(net.config.inputs, meshes=())
    plain = SplatNet(replace(net.config, inputs=inputs))
    state = net.state_dict()
    state["first.conv.weight"] = state["first.conv.weight"][:, : inputs.channels]
    plain.load_state_dict(state)
    return SplatNetRenderer(NetworkWeights(plain.eval(), {}, ""))


def draw(renderer, cloud, views=VIEWS):
    return renderer.draw(renderer.prepare(cloud), views)


def test_the_meshes_are_seen_each_in_its_place(cloud):
    """A mesh in the other's place is another image; without any it is splat-net's."""
    net = network(MESHES)
    first, second = MESHES
    images = [
        draw(fused(net, {first: a, second: b}), cloud)
        for a, b in ((Truth(), Failing()), (Failing(), Truth()), (Failing(), Failing()))
    ]
    assert np.abs(images[0] - images[1]).max() > 0.02
    assert np.abs(images[0] - images[2]).max() > 0.02
    np.testing.assert_allclose(images[2], draw(without_meshes(net), cloud), rtol=0, atol=1e-5)


def test_a_mesh_that_fails_is_noted(cloud):
    net = network(MESHES)
    renderer = fused(net, dict(zip(MESHES, (Failing(), Truth()), strict=True)))
    notes = renderer.prepare(cloud).notes
    assert notes == ("occupancy-net: no mesh, alpha-wrap: no faces", "upsampled-wrap: known")


def test_a_real_method_fails_on_a_point_and_it_is_drawn():
    net = network(MESHES)
    renderer = FusedNetRenderer(NetworkWeights(net.eval(), {}, ""))
    point = PointCloud([[0.1, 0.0, 0.0]])
    state = renderer.prepare(point)
    assert state.notes == ("upsampled-wrap: no mesh, input: 1 points; surfaces need at least 11",)
    methods = {"occupancy-net": renderer.methods["occupancy-net"], "upsampled-wrap": Failing()}
    expected = draw(fused(net, methods), point)
    np.testing.assert_array_equal(renderer.draw(state, VIEWS), expected)


@pytest.mark.parametrize("size", [128, 64])
def test_images_are_the_networks(cloud, size):
    """The mesh of the whole chair, and a cloud of one half of it: both are seen."""
    half = PointCloud(cloud.points[cloud.points[:, 1] > 0.1])
    net = network(MESHES)
    renderer = fused(net, dict.fromkeys(MESHES, Truth()))
    state = renderer.prepare(half)
    maps = torch.from_numpy(surface_maps(state.meshes[0], VIEWS, size)).repeat(1, 2, 1, 1)
    assert maps[:, 0, : size // 2].any()
    seen = Projection(state.surfels, cameras(VIEWS), net.config.inputs, size, maps)
    expected = renderer.splats.at_size(size).engine(seen.whole()).numpy()
    assert expected.std() > 0.01
    np.testing.assert_allclose(renderer.draw(state, VIEWS, size=size), expected, rtol=0, atol=1e-5)


def test_channels_of_points_are_those_without_meshes(cloud):
    inputs = network(MESHES).config.inputs
    plain = replace(inputs, meshes=())
    assert inputs.names[: plain.channels] == plain.names
    assert inputs.names[-10:-5] == (
        *("mesh occupancy-net coverage", "mesh occupancy-net nearness"),
        *(f"mesh occupancy-net normal {axis}" for axis in "xyz"),
    )
    surfels = stack([find_surfels(cloud.points)])
    maps = torch.rand(len(VIEWS), 10, 128, 128)
    both = Projection(surfels, cameras(VIEWS), inputs, maps=maps).whole()
    assert torch.equal(both[:, :-10], Projection(surfels, cameras(VIEWS), plain).whole())
    assert torch.equal(both[:, -10:], maps)
    for given, of, problem in (
        (maps, plain, "the inputs have no meshes; leave maps= out"),
        (None, inputs, "their maps are missing; give them as maps="),
    ):
        with pytest.raises(ValueError, match=problem):
            Projection(surfels, cameras(VIEWS), of, maps=given)


def test_a_clean_cloud_of_many_points_is_drawn_as_its_mesh():
    mesh = ProceduralObject("chair", "validation", 0).load()
    many = sample_surface(mesh, np.random.default_rng(0), 5000)
    renderer = fused(network(MESHES), dict.fromkeys(MESHES, Truth()))
    state = renderer.prepare(many)
    grey = in_one_colour(mesh, NEUTRAL_GREY)
    for size in (128, 200):
        true = draw_mesh(grey, VIEWS, size) / 255
        # A pixel has the mean normal of its samples in place of their mean shade.
        assert np.abs(renderer.draw(state, VIEWS, size=size) - true).mean() < 0.004
        covered = renderer.coverage(state, VIEWS, size)
        np.testing.assert_array_equal(covered, surface_maps(grey, VIEWS, size)[:, 0])
    few = renderer.prepare(sample_surface(mesh, np.random.default_rng(0), 500))
    larger = renderer.draw(few, VIEWS, size=200)
    assert larger.shape == (len(VIEWS), 200, 200, 3)
    assert np.abs(larger - draw_mesh(grey, VIEWS, 200) / 255).mean() > 0.01


def test_an_albedo_colours_the_mesh_of_many_points_and_leaves_its_coverage():
    mesh = ProceduralObject("chair", "validation", 0).load()
    many = sample_surface(mesh, np.random.default_rng(0), 5000)
    heads = ("grey", "albedo")
    renderer = fused(network(MESHES, heads=heads), dict.fromkeys(MESHES, Truth()))
    state = renderer.prepare(many)
    covered = surface_maps(mesh, VIEWS, 160)[:, 0]
    np.testing.assert_array_equal(renderer.coverage(state, VIEWS, 160), covered)
    image = renderer.draw(state, VIEWS, size=160)
    assert (image[covered == 0] == 1).all()
    assert np.ptp(image, axis=-1)[covered == 1].max() > 0.01  # no grey


def test_the_mesh_of_noisy_points_is_seen_and_not_drawn_alone():
    mesh = ProceduralObject("chair", "validation", 0).load()
    rng = np.random.default_rng(0)
    points = sample_surface(mesh, rng, 20_000).points
    noisy = PointCloud(points + rng.normal(scale=0.012, size=points.shape).astype(np.float32))
    renderer = fused(network(MESHES), dict(zip(MESHES, (Failing(), Truth()), strict=True)))
    state = renderer.prepare(noisy)
    assert len(state.meshes[-1].faces) == len(mesh.faces)
    true = draw_mesh(in_one_colour(mesh, NEUTRAL_GREY), VIEWS) / 255
    assert np.abs(renderer.draw(state, VIEWS) - true).mean() > 0.02
