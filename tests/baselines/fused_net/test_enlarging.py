"""Detail of a mesh on drawings that are enlarged: where both agree, and where they do not."""

import numpy as np
import pytest
import torch
from torch.nn.functional import interpolate

from baselines.fused_net.enlarging import up, with_detail
from baselines.splat_net.sharpening import planes_of_mesh
from data_prep.datasets.procedural import ProceduralObject
from data_prep.rendering.mesh import draw_mesh, mesh_coverage
from data_prep.rendering.raycast import surface_maps
from data_prep.scene import NEUTRAL_GREY, View, in_one_colour

VIEWS = (View(30, 20), View(-100, -10))


@pytest.fixture(scope="module")
def mesh():
    return in_one_colour(ProceduralObject("chair", "validation", 0).load(), NEUTRAL_GREY)


def premultiplied(planes):
    return torch.cat([planes[:, :1], planes[:, :1] * planes[:, 1:]], dim=1)


def test_planes_of_a_mesh_are_its_image(mesh):
    planes = planes_of_mesh(torch.from_numpy(surface_maps(mesh, VIEWS, 96)))
    image = 1 - premultiplied(planes)[:, 1].numpy()
    true = draw_mesh(mesh, VIEWS, 96)[..., 0] / 255
    # Normals, not shades, are averaged in a pixel, which shows where faces meet. OpenGL's shades
    # have 8 bits, and a chair of few faces is drawn by it.
    assert np.abs(image - true).mean() < 0.004
    covered = planes[:, 0].numpy()
    assert np.abs(covered - mesh_coverage(mesh, VIEWS, 96)).mean() < 0.001


@pytest.mark.parametrize("size", [64, 75])
def test_a_drawing_of_what_the_mesh_shows_becomes_the_mesh(mesh, size):
    fine = planes_of_mesh(torch.from_numpy(surface_maps(mesh, VIEWS, size)))
    coarse = interpolate(premultiplied(fine), size=32, mode="area")
    drawn = torch.cat([coarse[:, :1], coarse[:, 1:] / coarse[:, :1].clamp(min=1e-6)], dim=1)
    result = premultiplied(with_detail(drawn, fine))
    torch.testing.assert_close(result, premultiplied(fine), rtol=0, atol=1e-5)


def test_where_they_disagree_the_drawing_stays():
    drawn = torch.full((1, 2, 32, 32), 0.9)
    fine = torch.zeros(1, 2, 64, 64)
    fine[:, 0, :, ::2] = 1.0  # stripes: where the mesh is dark it would show
    result = premultiplied(with_detail(drawn, fine))
    # The agreement is exp(-(0.81 / (40 / 255))^2), below 1e-11.
    torch.testing.assert_close(result[:, 1], torch.full((1, 64, 64), 0.81), rtol=0, atol=1e-6)


def test_without_a_mesh_a_drawing_is_resampled():
    torch.manual_seed(0)
    drawn = torch.rand(1, 4, 32, 32)  # three planes of colours
    result = premultiplied(with_detail(drawn, torch.zeros(1, 2, 80, 80)))
    expected = up(premultiplied(drawn), 80).clamp(0, 1)
    # No colour is darker than alpha, by which it is multiplied, even where bicubic overshoots.
    expected[:, 1:] = torch.minimum(expected[:, 1:], expected[:, :1])
    torch.testing.assert_close(result, expected, rtol=0, atol=1e-5)
