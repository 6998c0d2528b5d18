from __future__ import annotations

import numpy as np
import pandas as pd

from data_prep.scene import PointCloud, View
from studies.class_noise import ONE_IN, ClassImages, Measure, nudged, summary, turned


def test_one_point_in_fifty_is_moved_by_one_rounding_error() -> None:
    points = np.random.default_rng(0).uniform(-1, 1, (20_000, 3)).astype(np.float32)
    moved = nudged(PointCloud(points), np.random.default_rng(1)).points
    changed = (moved != points).any(axis=1)
    # 400 are expected; four standard errors are 79
    assert abs(changed.sum() - len(points) / ONE_IN) < 79
    assert np.array_equal(moved[changed], np.nextafter(points[changed], np.float32(np.inf)))


def test_views_are_turned_by_a_tenth_of_a_degree() -> None:
    (view,) = turned([View(30.0, -20.0)])
    assert abs(view.azimuth_deg - 30.1) < 1e-12
    assert view.elevation_deg == -20.0


def test_true_images_are_perfect_by_all_that_compares_images() -> None:
    truth = np.full((2, 3, 128, 128, 3), 255, np.uint8)
    truth[:, :, 40:90, 30:100] = (120, 60, 20)
    sample = ClassImages("table", truth, truth)
    measure = Measure()
    actual = measure.objects(sample)
    for metric in ("ssim", "luminance", "contrast", "structure", "silhouette-iou"):
        assert np.allclose(actual[metric], 1.0, atol=1e-12), metric
    assert ((actual["class-confidence"] > 0) & (actual["class-confidence"] < 1)).all()
    assert measure.distances(sample)["fd-views"] < 1e-9


def test_the_summary_has_the_largest_move_of_a_class_and_that_of_their_mean() -> None:
    columns = ["change", "method", "class", "metric", "value", "by", "deviation"]
    of_a, of_b = (0.5, 0.25, 0.125), (0.8, -0.05, 0.0625)
    cells = [("turn", "splat", c, "ssim", *values) for c, values in (("a", of_a), ("b", of_b))]
    rows = pd.DataFrame(cells, columns=columns)
    assert summary(rows).splitlines()[-1] == "| turn | splat | ssim | 0.25 | 0.5 | 0.1 | 0.12 |"
