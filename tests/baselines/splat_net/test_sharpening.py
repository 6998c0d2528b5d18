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

INPUTS = Inputs(noise=True, meshes=("first", "upsampled-wrap"))
CLEAN, NOISY = 0.30, 0.38  # medians of the variation
FACING = 1 - NEUTRAL  # darkness of a grey face towards the camera
SMOOTH, CREASE, OUTLINE, OUTSIDE = 8, 12, 31, 40  # columns


def scene(noise=CLEAN, crease=40):
    """Return channels of an image whose first mesh covers 32 columns, and that drawing itself.

    From the 13th column on it is darker by `crease` levels.
    """
    channels = torch.zeros(1, INPUTS.channels, 32, 128)
    channels[:, INPUTS.names.index("noise 1"), 4:9, 4:9] = noise
    channels[:, INPUTS.of_points, :, :32] = 1
    channels[:, INPUTS.of_points + 4, :, :32] = 1
    channels[:, INPUTS.of_points + 4, :, 13:32] = (1 - crease / 255 / NEUTRAL) ** 2.2
    drawn = torch.zeros(1, 2, 32, 128)
    drawn[:, 0, :, :32], drawn[:, 1] = 1, FACING
    drawn[:, 1, :, 13:32] += crease / 255
    return channels, drawn


def taken(channels, drawn, column):
    """Return the grey of a pixel, 0..1, after the meshes are taken."""
    alpha, darkness = take_meshes(drawn, channels, INPUTS)[0, :, 16, column].tolist()
    return 1 - alpha * darkness


@pytest.mark.parametrize(
    ("column", "noise", "width"),
    [
        (CREASE, CLEAN, 20),
        (OUTLINE, CLEAN, 40),
        (OUTLINE, NOISY, 40),
        (CREASE, NOISY, None),  # such shading is that of the noise
        (SMOOTH, CLEAN, None),
    ],
)
@pytest.mark.parametrize("levels", [1, 20, 40])
def test_a_mesh_has_the_more_of_a_pixel_the_nearer_it_is_to_what_is_drawn(
    column, noise, width, levels
):
    channels, drawn = scene(noise)
    drawn[:, 1] += levels / 255  # darker than the mesh
    share = 0 if width is None else math.exp(-((levels / width) ** 2))
    mesh = NEUTRAL - 40 / 255 * (column == OUTLINE)
    expected = mesh - (1 - share) * levels / 255
    assert taken(channels, drawn, column) == pytest.approx(expected, abs=1e-6)
    assert taken(channels, drawn, OUTSIDE) == 1


def test_an_outline_is_as_wide_in_a_larger_image():
    channels, drawn = (some.repeat_interleave(2, dim=3) for some in scene(NOISY))
    drawn[:, 1] += 40 / 255
    edge = 2 * OUTLINE + 1
    shares = [(taken(channels, drawn, edge - k) - NEUTRAL) * 255 / 40 + 2 for k in range(6)]
    assert shares == pytest.approx([math.exp(-1)] * 4 + [0] * 2, abs=1e-5)


@pytest.mark.parametrize(
    ("noise", "crease", "part"),
    [((CLEAN + NOISY) / 2, 40, 0.5), (CLEAN, 30, 0.5), (CLEAN, 20, 0), (CLEAN, 60, 1)],
)
def test_some_noise_or_a_flat_crease_have_a_part_of_the_shading(noise, crease, part):
    channels, drawn = scene(noise, crease)
    drawn[:, 1] += 20 / 255
    expected = NEUTRAL - (1 - math.exp(-1) * part) * 20 / 255
    assert taken(channels, drawn, CREASE) == pytest.approx(expected, abs=1e-6)


def test_a_mesh_where_nothing_is_drawn_does_not_show():
    channels, drawn = scene()
    drawn[:, 0] = 0
    assert taken(channels, drawn, CREASE) == 1
    assert taken(channels, drawn, OUTLINE) == 1
    drawn[:, 0, :, 32:], drawn[:, 1, :, 32:] = 1, 0  # white, but drawn: an outline a pixel off
    apart = 255 * FACING + 40
    share = math.exp(-((apart / 40) ** 2))
    assert 0 < share < 0.03
    expected = 1 - share * apart / 255
    assert taken(channels, drawn, OUTLINE) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(
    ("points", "noise", "part"),
    [(2048, CLEAN, 1), (5000, CLEAN, 1), (1280, CLEAN, 0.5), (512, CLEAN, 0), (2048, NOISY, 0)],
)
@pytest.mark.parametrize("column", [SMOOTH, OUTLINE])
def test_of_an_exact_mesh_even_sides_are_taken_where_points_are_many_and_clean(
    points, noise, part, column
):
    channels, drawn = scene(noise)
    channels[:, INPUTS.of_points + 5 :] = channels[:, INPUTS.of_points : -5]
    channels[:, INPUTS.of_points : -5] = 0  # the first mesh was not made
    # The points lie in a hundred pixels, which have log(1 + n) of n points each.
    channels[:, INPUTS.names.index("density in 1"), 0, :100] = math.log(1 + points / 100)
    drawn[:, 1] += 30 / 255
    width = 50 if column == OUTLINE else 30
    mesh = NEUTRAL - 40 / 255 * (column == OUTLINE)
    share = part * math.exp(-((30 / width) ** 2))
    expected = mesh - (1 - share) * 30 / 255
    assert taken(channels, drawn, column) == pytest.approx(expected, abs=1e-5)


def test_without_a_mesh_in_sight_it_is_what_the_network_draws():
    channels, _ = scene()
    channels[:, INPUTS.of_points :] = 0
    channels[:, INPUTS.names.index("density in 1")] = 1
    # Where alpha is next to nothing, no darkness is seen.
    drawn = 0.1 + 0.9 * torch.rand(1, 2, 32, 128, generator=torch.Generator().manual_seed(0))
    torch.testing.assert_close(take_meshes(drawn, channels, INPUTS), drawn, rtol=0, atol=1e-6)


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
    outline = torch.zeros_like(truth, dtype=torch.bool)
    outline[:, :, 1:] = (truth[:, :, 1:] == 1) != (truth[:, :, :-1] == 1)
    errors = [
        (dark - (1 - truth))[outline].abs().mean() for dark in (drawn[:, 1], alpha * darkness)
    ]
    assert errors[0] > 3.5 / 255
    # An error of s levels leaves s (1 - exp(-s^2 / 40^2)): of these .03 on average. Facets that
    # share a pixel have no mean normal.
    assert errors[1] < 0.2 * errors[0]
