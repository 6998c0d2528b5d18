from __future__ import annotations

import numpy as np

from bench.report.pareto import covered, place_labels

AREA = np.array([0.0, 0.0, 300.0, 200.0])


def boxes(centres, sizes):
    return np.concatenate([centres - sizes / 2, centres + sizes / 2], axis=1)


def test_labels_of_a_crowd_cover_nothing():
    rng = np.random.default_rng(0)
    anchors = np.stack([np.linspace(60, 240, 10), 100 + rng.normal(0, 4, 10)], axis=1)
    sizes = np.stack([rng.uniform(10, 40, 10), np.full(10, 8.0)], axis=1)
    points = boxes(anchors, np.full((10, 2), 6.0))
    placed = boxes(place_labels(anchors, sizes, points, AREA), sizes)
    assert covered(placed, points).max() == 0
    itself = sizes.prod(axis=1)  # each label covers itself, and no other
    np.testing.assert_allclose(covered(placed, placed), itself, atol=1e-9)
    assert (placed[:, :2] >= 0).all()
    assert (placed[:, 2:] <= AREA[2:]).all()
