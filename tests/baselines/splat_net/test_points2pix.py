"""points2pix: what its two inputs do, and that it is drawn, trained and stored like splat-net."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import torch

from baselines.splat_net.config import SplatNetConfig
from baselines.splat_net.network import POINTS2PIX
from baselines.splat_net.points2pix import PointNetCode, Points2Pix, build
from baselines.splat_net.projection import Projection, cameras
from baselines.splat_net.renderer import SplatNetRenderer
from baselines.splat_net.surfels import find_surfels, stack
from baselines.splat_net.train import SplatNetTrainer
from baselines.splat_net.weights import export, load_weights
from data_prep.scene import PointCloud, View
from learning.training_loop import train
from learning.weights import NetworkWeights

VIEWS = [View(20, 10), View(-100, -5)]
GREY_ALONE = dataclasses.replace(POINTS2PIX, heads=("grey",))


def cloud(count=300, seed=0):
    return np.random.default_rng(seed).uniform(-0.5, 0.5, (count, 3)).astype(np.float32)


def seen(points):
    projection = Projection(stack([find_surfels(points)]), cameras(VIEWS), POINTS2PIX.inputs)
    return projection.whole(), projection.points


@pytest.fixture(scope="module")
def network():
    torch.manual_seed(0)
    result = build(POINTS2PIX)
    assert isinstance(result, Points2Pix)
    for layer in result.modules():  # as if trained: each hands on as much as it is given
        if isinstance(layer, (torch.nn.Conv1d, torch.nn.Conv2d)):
            torch.nn.init.kaiming_normal_(layer.weight, nonlinearity="relu")
        elif isinstance(layer, torch.nn.ConvTranspose2d):  # a pixel is the sum of 2 x 2 products
            torch.nn.init.normal_(layer.weight, std=(2 / (4 * layer.in_channels)) ** 0.5)
    return result.eval().requires_grad_(False)


def test_a_code_depends_on_the_places_alone():
    torch.manual_seed(1)
    code = PointNetCode().eval()
    points = torch.from_numpy(cloud().T)[None]
    order = torch.randperm(points.shape[2])
    with torch.no_grad():
        expected = code(points)
        assert expected.shape == (1, 128)
        # a maximum does not round; a sum of 128 products may, in another order
        torch.testing.assert_close(code(points[:, :, order]), expected, rtol=0, atol=1e-6)
        twice = torch.cat([points, points[:, :, :40]], dim=2)
        torch.testing.assert_close(code(twice), expected, rtol=0, atol=1e-6)
        assert (code(points + 0.1) - expected).abs().max() > 1e-3


def test_both_inputs_count(network):
    channels, points = seen(cloud())
    drawn = network(channels, points)
    assert drawn.shape == (2, 5, 128, 128)
    for other in ((torch.zeros_like(channels), points), (channels, seen(cloud(seed=3))[1])):
        assert (network(*other) - drawn).abs().max() > 1e-3


def test_points_are_seen_about_the_middle_of_the_object(network):
    given = []
    points = cloud()
    with network.code.register_forward_hook(lambda module, inputs, _: given.extend(inputs)):
        network(*seen(points))
    # turned about the origin, not moved: the lengths are those of the cloud
    lengths = given[0][0].double().norm(dim=0).sort().values
    expected = np.sort(np.linalg.norm(points.astype(np.float64), axis=1))
    assert lengths.numpy() == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize("wrong", [{"size": 256}, {"precision": "bfloat16"}])
def test_other_sizes_and_precisions_are_refused(wrong):
    with pytest.raises(ValueError, match="points2pix draws only 128 pixels in float32"):
        SplatNetRenderer(NetworkWeights(build(GREY_ALONE), {}, ""), **wrong)


def test_it_is_trained_and_stored_like_splat_net(data, tmp_path):
    config = SplatNetConfig(network=POINTS2PIX, objective="pix2pix", steps=2, cool_down=1, batch=4)
    path = train(SplatNetTrainer, data, config, tmp_path / "run")
    export(path, tmp_path / "weights.safetensors", "grey")
    weights = load_weights(tmp_path / "weights.safetensors")
    assert isinstance(weights.network, Points2Pix)
    assert weights.network.config == GREY_ALONE
    assert weights.card["objective"] == "pix2pix"
    images = SplatNetRenderer(weights).draw(
        SplatNetRenderer(weights).prepare(PointCloud(cloud())), VIEWS
    )
    assert np.isfinite(images).all()
    assert np.ptp(images, axis=3).max() == 0  # neutral grey
