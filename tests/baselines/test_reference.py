from __future__ import annotations

import numpy as np
import pytest

from baselines.reference import Blank, TrueMesh
from data_prep.clouds.conditions import CONDITIONS
from data_prep.datasets.objects import grey
from data_prep.failures import StageFailure
from data_prep.rendering.images import blank, to_uint8
from data_prep.rendering.opengl import render
from data_prep.scene import PointCloud, View

from .clouds import chair_cloud

CLOUD = chair_cloud()
VIEWS = [View(0, 0), View(100, -40), View(-180, 90)]


def test_the_ceiling_is_the_ground_truth_bit_for_bit() -> None:
    images = TrueMesh().draw(TrueMesh().prepare(CLOUD), VIEWS)
    assert images.dtype == np.float32
    truth = render(CLOUD.source, VIEWS)
    assert (truth < 255).any(axis=(1, 2, 3)).all()
    np.testing.assert_array_equal(to_uint8(images), truth)


def test_the_ceiling_without_colour_is_the_unpainted_mesh() -> None:
    method = TrueMesh(coloured=False)
    actual = to_uint8(method.draw(method.prepare(CLOUD), VIEWS))
    np.testing.assert_array_equal(actual, render(grey(CLOUD.source), VIEWS))
    assert (actual == actual[..., :1]).all()


def test_the_ceiling_sees_through_every_condition_and_needs_the_mesh() -> None:
    for condition in CONDITIONS:
        perturbed = condition.perturbation.apply(CLOUD, np.random.default_rng(1))
        assert TrueMesh().prepare(perturbed) is CLOUD.source, condition.id
    with pytest.raises(StageFailure, match="mesh is not known") as failure:
        TrueMesh().prepare(PointCloud(CLOUD.points))
    assert failure.value.stage == "input"


@pytest.mark.parametrize("points", [np.zeros((0, 3)), np.full((5, 3), np.nan)])
def test_the_floor_is_white_whatever_the_cloud(points: np.ndarray) -> None:
    state = Blank().prepare(PointCloud(points))
    images = Blank().draw(state, VIEWS)
    assert images.shape == (3, 128, 128, 3)
    assert images.dtype == np.float32
    assert (images == 1.0).all()
    np.testing.assert_array_equal(to_uint8(images), blank(3))
