from __future__ import annotations

import numpy as np

from bench.suites.latent.figures import Strip, StripTile, draw_cloud, strips_figure
from data_prep.scene import View

FRONT = View(0, 0)


def drawn(strips):
    """The cells of the figure, [rows, columns]."""
    figure = strips_figure(strips, FRONT)
    return np.array(figure.axes).reshape(-1, len(strips[0].tiles))


def tile(seed, truth=False):
    rng = np.random.default_rng(seed)
    image, true = rng.integers(0, 256, (2, 128, 128, 3), dtype=np.uint8)
    cloud = rng.uniform(-0.5, 0.5, (30, 3)).astype(np.float32)
    return StripTile(f"tile {seed}", cloud, image, true if truth else None)


def shown(axis):
    return [np.asarray(image.get_array()) for image in axis.images]


def test_clouds_stand_above_images():
    strips = [Strip("one", (tile(0), tile(1))), Strip("two", (tile(2), tile(3)))]
    cells = drawn(strips)
    assert cells.shape == (4, 2)
    assert [axis.get_title() for axis in cells[0]] == ["tile 0", "tile 1"]
    assert [axis.get_ylabel() for axis in cells[:, 0]] == [
        *("one\ndecoded", "one\ndrawn", "two\ndecoded", "two\ndrawn")
    ]
    for row, strip in zip((0, 2), strips, strict=True):
        for column, shown_tile in enumerate(strip.tiles):
            assert np.array_equal(shown(cells[row, column])[0], draw_cloud(shown_tile.cloud, FRONT))
            assert np.array_equal(shown(cells[row + 1, column])[0], shown_tile.image)


def test_a_cloud_is_drawn_where_it_is():
    cloud = np.array([[0, 0.4, 0], [0.01, 0.4, 0]], np.float32)
    image = draw_cloud(cloud, FRONT)
    rows, columns, _ = np.nonzero(image < 255)
    assert rows.max() < 64 - 20  # up
    assert abs(columns.mean() - 64) < 2
