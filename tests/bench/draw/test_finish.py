from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from baselines.splat import Splat
from bench.draw.finish import resized, without_background
from bench.running.colours import guessed_coverage
from data_prep.clouds.sampling import sample_surface
from data_prep.datasets.registry import open_dataset
from data_prep.randomness import generator
from data_prep.rendering.raycast import cast
from data_prep.scene import NEUTRAL_GREY, View, in_one_colour

VIEWS = [View(30, 20), View(-120, -30)]


@pytest.fixture(scope="module")
def chair():
    return open_dataset("procedural").objects("chair", limit=1, endless_limit=1)[0].load()


def on(ground, rgba):
    """Return the image over a ground of one grey, with 8 bits, as Pillow composes it."""
    image = Image.fromarray(rgba)
    page = Image.new("RGBA", image.size, (ground, ground, ground, 255))
    return np.asarray(Image.alpha_composite(page, image).convert("RGB")).astype(int)


@pytest.mark.parametrize("size", [16, 128, 300])
def test_over_white_a_transparent_image_is_the_opaque_one(chair, size):
    """Lay smooth and sharp edges, colours, greys a little off white, and noise over white.

    It holds whatever the coverage is: one less than the darkness would ask for colours below black.
    """
    rng = generator("test")
    mesh = cast(in_one_colour(chair, (200, 90, 20)), VIEWS)
    splats = Splat().prepare(sample_surface(chair, rng))
    noise = rng.integers(0, 256, (2, 128, 128, 3), dtype=np.uint8)
    off_white = np.minimum(mesh, rng.integers(245, 256, mesh.shape, dtype=np.uint8))
    splat = np.rint(255 * Splat().draw(splats, VIEWS)).astype(np.uint8)
    for images in (mesh, splat, noise, off_white, np.full_like(mesh, 255), np.zeros_like(mesh)):
        opaque, of_any = resized(images, size), rng.random(images.shape[:3], np.float32)
        for coverage in (guessed_coverage(images), np.ones_like(of_any), 0 * of_any, of_any):
            found = without_background(images, coverage, size)
            assert found.shape == (2, size, size, 4)
            for image, rgba in zip(opaque, found, strict=True):
                assert np.abs(on(255, rgba) - image).max() <= 1


def test_the_opacity_is_the_coverage_and_where_it_is_guessed_nearly_that(chair):
    """A black mesh on white tells it: a quarter for each sample of four."""
    covered = 1 - cast(in_one_colour(chair, (0, 0, 0)), VIEWS)[..., 0] / 255
    images = cast(in_one_colour(chair, NEUTRAL_GREY), VIEWS)
    exact = without_background(images, covered.astype(np.float32), 128)
    assert np.array_equal(exact[..., 3], np.rint(255 * covered))
    rgba = without_background(images, guessed_coverage(images), 128)
    opacity = rgba[..., 3] / 255
    assert (opacity[covered == 0] == 0).all()
    assert opacity[covered == 1].mean() > 0.98
    edge = (covered > 0) & (covered < 1)
    assert np.abs(opacity - covered)[edge].mean() < 0.1  # 0.5 were each edge opaque


def test_a_resized_image_keeps_its_frames_and_areas_of_one_colour():
    frames = np.full((2, 128, 128, 3), 255, np.uint8)
    frames[1, :64] = (200, 0, 10)
    large = resized(frames, 512)
    assert large.shape == (2, 512, 512, 3)
    assert (large[0] == 255).all()
    assert (large[1, :240] == (200, 0, 10)).all()
    assert (large[1, 272:] == 255).all()
    assert np.array_equal(resized(frames, 128), frames)
