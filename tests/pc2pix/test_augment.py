from __future__ import annotations

import numpy as np
import pytest
import torch

from data_prep.datasets.registry import ProceduralObject
from data_prep.rendering.opengl import render
from data_prep.scene import Mesh, View
from pc2pix.augment import Scene, mirror, take_evenly


@pytest.mark.parametrize(
    ("have", "rows"), [(2, [0, 0, 1, 1]), (3, [0, 0, 1, 2]), (8, [0, 2, 4, 6])]
)
def test_evenly_taken(have, rows):
    points = torch.arange(have)[None, :, None].expand(1, have, 3)
    assert take_evenly(points, 4)[0, :, 0].tolist() == rows


def test_a_mirrored_scene_is_what_the_renderer_draws_of_the_mirrored_shape():
    mesh = ProceduralObject("chair", "train", 3).load()
    vertices = (mesh.vertices * [-1, 1, 1]).astype(mesh.vertices.dtype)
    flipped = Mesh(vertices, np.ascontiguousarray(mesh.faces[:, ::-1]), mesh.face_colors)
    there, truth = (
        torch.from_numpy(render(shape, [View(azimuth, 20.0)])).permute(0, 3, 1, 2)
        for shape, azimuth in ((mesh, 37.0), (flipped, -37.0))
    )
    points = torch.tensor([[[0.1, 0.2, 0.3]]]).expand(2, -1, -1)
    elevation, azimuth = torch.full((2, 1), 0.75), torch.full((2, 1), 37 / 360 + 0.5)
    scene = Scene(points, there.expand(2, -1, -1, -1), elevation, azimuth)
    flip = mirror(scene, torch.tensor([True, False]))
    torch.testing.assert_close(flip.points[:, 0], torch.tensor([[-0.1, 0.2, 0.3], [0.1, 0.2, 0.3]]))
    torch.testing.assert_close(flip.azimuth01[:, 0], torch.tensor([0.5 - 37 / 360, 0.5 + 37 / 360]))
    assert torch.equal(flip.elevation01, elevation)
    assert torch.equal(flip.images[1], there[0])
    difference, unmirrored = (
        (images.int() - truth[0].int()).abs().float() for images in (flip.images[0], there[0])
    )
    # the samples of anti-aliasing do not lie symmetrically in a pixel, so edges differ
    assert (difference > 2).float().mean() < 0.05
    assert difference.mean() < 0.1 * unmirrored.mean()
