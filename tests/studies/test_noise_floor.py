from __future__ import annotations

import numpy as np
import pytest

from bench.catalogue.metrics import IMAGE_METRICS
from bench.metrics.image_scores import scores
from data_prep.rendering.opengl import render
from data_prep.scene import PointCloud
from studies.images import make_scene, turned
from studies.noise_floor import (
    ONE_IN,
    ROUNDING,
    TURN,
    means,
    moves_of_chairs,
    nudged,
)


def white(views):
    return np.full((views, 128, 128, 3), 255, np.uint8)


def test_one_point_in_fifty_is_moved_by_one_rounding_error() -> None:
    points = np.random.default_rng(0).uniform(-1, 1, (20_000, 3)).astype(np.float32)
    moved = nudged(PointCloud(points), np.random.default_rng(1)).points
    changed = (moved != points).any(axis=1)
    # 400 are expected; four standard errors are 79
    assert abs(changed.sum() - len(points) / ONE_IN) < 79
    assert np.array_equal(moved[changed], np.nextafter(points[changed], np.float32(np.inf)))


def test_means_are_over_the_views_that_have_a_value() -> None:
    drawn = np.stack([white(2), white(2)])
    truth = drawn.copy()
    truth[0, 0, 40:42, 20:100] = 0  # a thin bar, in one view only
    actual = means((truth, drawn))
    assert actual["thin-recall"].tolist() == [0.0, pytest.approx(np.nan, nan_ok=True)]
    assert actual["ssim"][0] == pytest.approx(scores(truth[0], drawn[0])["ssim"].mean(), abs=1e-12)
    assert actual["ssim"][1] == 1.0


@pytest.mark.opengl
def test_moves_of_white_images_are_those_of_the_truth() -> None:
    scene = make_scene("chair", 2, 2, 0)
    result = moves_of_chairs(scene, "2048", {TURN: ("blank",), ROUNDING: ("constant",)})
    assert [*result["method"]] == ["blank"] * 2 + ["constant"] * 2
    assert {*IMAGE_METRICS} < {*result.columns}
    turns = result[result["change"] == TURN]["ssim"]
    for by, mesh, views in zip(turns, scene.meshes, scene.views, strict=True):
        before, after = (
            scores(render(mesh, seen), white(2))["ssim"].mean() for seen in (views, turned(views))
        )
        assert by == pytest.approx(after - before, abs=1e-12)
        assert by != 0
    assert (result[result["change"] == ROUNDING]["ssim"] == 0).all()  # it sees no cloud
