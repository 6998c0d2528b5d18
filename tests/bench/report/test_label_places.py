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


def test_where_there_is_no_room_least_is_covered():
    full = np.array([[-100.0, -100.0, 400.0, 300.0]])
    gap = np.array([[-100.0, 91.0, 400.0, 300.0], [-100.0, -100.0, 400.0, 85.0]])
    anchor, size = np.array([[150.0, 100.0]]), np.array([[30.0, 8.0]])
    assert np.isfinite(place_labels(anchor, size, full, AREA)).all()
    (centre,) = place_labels(anchor, size, gap, AREA)  # 6 of the 8 fit between them
    assert covered(boxes(centre[None], size), gap)[0] <= 30 * 8 / 2
