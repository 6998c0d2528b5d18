"""`pc2pix.draw_cloud` and `pc2pix.turntable`, and the examples of docs/python.md."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import bench
import pc2pix
from bench.metrics import ssim
from data_prep.clouds.normalise import normalise_points
from data_prep.files.clouds import load_points, save_ply
from data_prep.randomness import generator
from data_prep.rendering.images import to_uint8
from data_prep.scene import View
from pc2pix import images

PAGE = Path(__file__).parents[2] / "docs" / "python.md"


class Telling:
    """A stand-in for a renderer, with images that are white but for its view and its cloud."""

    def prepare(self, cloud):
        return cloud.points

    def draw(self, state, views):
        self.given = state
        images = np.ones((len(views), 128, 128, 3), np.float32)
        images[:, 0, 0] = np.array([view.azimuth_deg for view in views])[:, None] / 255
        images[:, 0, 1] = np.array([view.elevation_deg for view in views])[:, None] / 255
        return images


@pytest.fixture(scope="module")
def points():
    return generator("test").normal(size=(300, 3)) * (1, 2, 3)


def test_an_image_is_what_the_bundled_network_draws_read_once(points):
    renderer = pc2pix.load("all")  # the cloud is of an unknown object
    cloud = normalise_points(points)
    (expected,) = renderer.draw(renderer.prepare(cloud), [View(-50.0, 10.0)])
    assert np.array_equal(pc2pix.draw_cloud(points, -50, 10), to_uint8(expected))
    assert images.bundled() is images.bundled()


def test_views_and_axes(points):
    teller = Telling()
    image = pc2pix.draw_cloud(points, renderer=teller)
    assert (image[0, 0, 0], image[0, 1, 0]) == (30, 20)
    assert np.array_equal(teller.given, normalise_points(points).points)
    x, y, z = points.T
    other = np.stack([-x, z, y], axis=1)
    turned = pc2pix.turntable(other, 8, 15, up="z", front="-y", renderer=teller)
    assert np.array_equal(teller.given, normalise_points(points).points)
    assert turned[:, 0, 0, 0].tolist() == [0, 45, 90, 135, 180, 225, 255, 255]  # clipped at 255
    assert (turned[:, 0, 1, 0] == 15).all()
    assert pc2pix.turntable(points, 0, renderer=teller).shape == (0, 128, 128, 3)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda points: pc2pix.draw_cloud(points[:0]), "the cloud has no points"),
        (lambda points: pc2pix.draw_cloud(points[:, :2]), r"points: expected real numbers \[N, 3"),
        (lambda points: pc2pix.draw_cloud(points, up="w"), "up 'w': no axis"),
        (lambda points: pc2pix.turntable(points, elevation_deg=91), "elevation_deg must lie in"),
    ],
)
def test_what_cannot_be_drawn(points, call, message):
    with pytest.raises(ValueError, match=message):
        call(points)
    with pytest.raises(AttributeError, match="module 'pc2pix' has no attribute 'draw'"):
        pc2pix.draw  # noqa: B018


@pytest.mark.slow
def test_the_examples_of_the_page(tmp_path, points):
    save_ply(points.astype(np.float32), tmp_path / "cloud.ply")
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    assert len(blocks) == 6
    script = tmp_path / "example.py"
    script.write_text("\n".join(blocks) + "\nassert other.shape == image.shape\n")
    done = subprocess.run(
        [sys.executable, script], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    expected = bench.draw_cloud(load_points(tmp_path / "cloud.ply"), 30, 20)
    maps, like_blank, pairs = done.stdout.splitlines()
    assert maps.startswith("(128, 128) 1.0 [")
    blank = np.full_like(expected, 255)
    assert float(like_blank) == pytest.approx(ssim(expected, blank).ssim, abs=1e-4)
    assert pairs == "(36,)"
    with Image.open(tmp_path / "chair.png") as image:
        # Another process may have another number of threads: a grey level by rounding.
        np.testing.assert_allclose(np.asarray(image).astype(int), expected, rtol=0, atol=1)
    with Image.open(tmp_path / "turn.gif") as turn:
        assert (turn.n_frames, turn.size) == (36, (128, 128))
    with Image.open(tmp_path / "surface.png") as surface:
        assert (np.asarray(surface) < 255).any()
