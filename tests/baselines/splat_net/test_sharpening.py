from __future__ import annotations

import math

import pytest
import torch

from baselines.splat_net.network import NEUTRAL
from baselines.splat_net.projection import Inputs
from baselines.splat_net.sharpening import take_meshes
from data_prep.datasets.objects import grey as in_grey
from data_prep.datasets.registry import ProceduralObject
from data_prep.rendering.raycast import cast, surface_maps
from data_prep.scene import View

INPUTS = Inputs(noise=True, meshes=("first", "second"))
CLEAN, NOISY = 0.30, 0.38  # medians of the variation
FACING = 1 - NEUTRAL  # darkness of a grey face towards the camera
INSIDE, OUTLINE, OUTSIDE = 8, 15, 28  # columns


def scene(noise=CLEAN):
    """Channels of one image whose left half the first mesh covers, and that drawing itself."""
    channels = torch.zeros(1, INPUTS.channels, 32, 128)
    channels[:, INPUTS.names.index("noise 1"), 4:9, 4:9] = noise
    channels[:, INPUTS.of_points, :, :16] = 1
    channels[:, INPUTS.of_points + 4, :, :16] = 1
    drawn = torch.zeros(1, 2, 32, 128)
    drawn[:, 0, :, :16], drawn[:, 1] = 1, FACING
    return channels, drawn


def taken(channels, drawn, column):
    """The image of a pixel, 0..1, after the meshes are taken."""
    alpha, darkness = take_meshes(drawn, channels, INPUTS)[0, :, 16, column].tolist()
    return 1 - alpha * darkness


@pytest.mark.parametrize(
    ("column", "noise", "width"),
    [
        (INSIDE, CLEAN, 20),
        (OUTLINE, CLEAN, 40),
        (OUTLINE, NOISY, 40),
        (INSIDE, NOISY, None),  # such shading is that of the noise
    ],
)
@pytest.mark.parametrize("levels", [1, 20, 40])
def test_a_mesh_has_the_more_of_a_pixel_the_nearer_it_is_to_what_is_drawn(
    column, noise, width, levels
):
    channels, drawn = scene(noise)
    drawn[:, 1] += levels / 255  # darker than the mesh
    share = 0 if width is None else math.exp(-((levels / width) ** 2))
    expected = NEUTRAL - (1 - share) * levels / 255
    assert taken(channels, drawn, column) == pytest.approx(expected, abs=1e-6)
    assert taken(channels, drawn, OUTSIDE) == 1


def test_a_cloud_with_some_noise_has_half_of_the_shading():
    channels, drawn = scene((CLEAN + NOISY) / 2)
    drawn[:, 1] += 20 / 255
    expected = NEUTRAL - (1 - math.exp(-1) / 2) * 20 / 255
    assert taken(channels, drawn, INSIDE) == pytest.approx(expected, abs=1e-6)


def test_a_mesh_where_nothing_is_drawn_does_not_show():
    channels, drawn = scene()
    drawn[:, 0] = 0
    assert taken(channels, drawn, INSIDE) == 1
    assert taken(channels, drawn, OUTLINE) == 1
    drawn[:, 0, :, 16:], drawn[:, 1, :, 16:] = 1, 0  # white, but drawn: an outline a pixel off
    share = math.exp(-((255 * FACING / 40) ** 2))
    assert 0 < share < 0.03
    assert taken(channels, drawn, OUTLINE) == pytest.approx(1 - share * FACING, abs=1e-6)


def test_the_nearer_of_two_meshes_is_taken():
    channels, drawn = scene()
    second = INPUTS.of_points + 5
    channels[:, second : second + 5] = channels[:, second - 5 : second]
    channels[:, second + 4] *= 0.5
    drawn[:, 1] = 1 - NEUTRAL * 0.5 ** (1 / 2.2)
    assert taken(channels, drawn, INSIDE) == pytest.approx(1 - drawn[0, 1, 0, 0].item(), abs=1e-6)


def test_without_a_mesh_in_sight_it_is_what_the_network_draws():
    channels, _ = scene()
    channels[:, INPUTS.of_points :] = 0
    drawn = torch.rand(1, 2, 32, 128)
    assert take_meshes(drawn, channels, INPUTS) is drawn


@pytest.mark.parametrize("size", [128, 256])
def test_a_drawing_near_to_the_truth_becomes_as_sharp_as_the_renderer_draws_it(size):
    mesh = ProceduralObject("chair", "validation", 0).load()
    views = [View(20, 10), View(-100, -30)]
    channels = torch.zeros(2, INPUTS.channels, size, size)
    channels[:, INPUTS.of_points : INPUTS.of_points + 5] = torch.from_numpy(
        surface_maps(mesh, views, size)
    )
    truth = torch.from_numpy(cast(in_grey(mesh), views, size=size)[..., 0]).float() / 255
    noise = torch.randn(truth.shape, generator=torch.Generator().manual_seed(0))
    drawn = torch.stack([torch.ones_like(truth), 1 - truth + noise * 5 / 255], dim=1)
    alpha, darkness = take_meshes(drawn, channels, INPUTS).unbind(1)
    seen = truth < 1
    before = (drawn[:, 1] - (1 - truth))[seen].abs().mean()
    after = (alpha * darkness - (1 - truth))[seen].abs().mean()
    assert before > 3.5 / 255
    # Errors of s levels leave s (1 - exp(-s^2 / w^2)): of 5 levels .07 within, .02 at outlines, on
    # average more for the large ones; facets that share a pixel have no mean normal.
    assert after < 0.25 * before
