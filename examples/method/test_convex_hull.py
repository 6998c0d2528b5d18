"""The method draws a cloud, and draws it again alike."""

import numpy as np
from convex_hull import METHOD

from data_prep.randomness import generator
from data_prep.scene import PointCloud, View


def test_a_cloud_is_drawn_on_white():
    """An object in the middle leaves the corners of the image white."""
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (200, 3)).astype(np.float32)
    renderer = METHOD.load("cpu")
    state = renderer.prepare(PointCloud(points), generator(0))
    images = renderer.draw(state, [View(30.0, 20.0)], generator(0))
    assert images.shape == (1, 128, 128, 3)
    assert images[0, 0, 0].tolist() == [1, 1, 1]
    assert images[0, 64, 64].max() < 1
    assert np.array_equal(images, renderer.draw(state, [View(30.0, 20.0)], generator(0)))
