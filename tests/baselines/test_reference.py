from __future__ import annotations

import hashlib

import numpy as np
import pytest

from baselines.reference import CONSTANT_IMAGE, Blank, Constant, TrueMesh
from bench.catalogue.conditions import CONDITIONS
from bench.catalogue.methods import find_method
from data_prep.datasets.objects import grey
from data_prep.failures import StageFailure
from data_prep.rendering.images import read_image, to_uint8
from data_prep.rendering.opengl import render
from data_prep.scene import PointCloud, View

from .clouds import chair_cloud

CLOUD = chair_cloud()
VIEWS = [View(0, 0), View(100, -40), View(-180, 90)]


@pytest.mark.parametrize(
    ("coloured", "mesh"), [(True, CLOUD.source), (False, grey(CLOUD.source))], ids=["own", "grey"]
)
def test_the_ceiling_is_the_ground_truth_bit_for_bit(coloured: bool, mesh) -> None:
    method = TrueMesh(coloured=coloured)
    actual = to_uint8(method.draw(method.prepare(CLOUD), VIEWS))
    np.testing.assert_array_equal(actual, render(mesh, VIEWS))
    assert (actual < 255).any(axis=(1, 2, 3)).all()
    assert (actual == actual[..., :1]).all() != coloured


def test_the_ceiling_sees_through_every_condition_and_needs_the_mesh() -> None:
    for condition in CONDITIONS:
        perturbed = condition.perturbation.apply(CLOUD, np.random.default_rng(1))
        assert TrueMesh().prepare(perturbed) is CLOUD.source, condition.id
    with pytest.raises(StageFailure, match="input: the cloud was not sampled from a known mesh"):
        TrueMesh().prepare(PointCloud(CLOUD.points))


@pytest.mark.parametrize("points", [np.zeros((0, 3)), np.full((5, 3), np.nan)])
def test_floors_draw_the_same_image_whatever_the_cloud(points: np.ndarray) -> None:
    image = np.random.default_rng(0).integers(0, 256, (128, 128, 3), np.uint8)
    for method, expected in ((Constant(image), image), (Blank(), np.full_like(image, 255))):
        images = method.draw(method.prepare(PointCloud(points)), VIEWS)
        assert images.dtype == np.float32
        np.testing.assert_array_equal(to_uint8(images), np.stack([expected] * 3))


def test_the_bundled_image() -> None:
    image, _ = read_image(CONSTANT_IMAGE)
    method = find_method("constant")
    assert method.identity() == f"picture {hashlib.sha256(image.tobytes()).hexdigest()}"
    drawn = method.load("cpu").draw(None, VIEWS[:1], np.random.default_rng(0))
    np.testing.assert_array_equal(to_uint8(drawn)[0], image)
    assert image.min() > 200  # SSIM punishes any contrast in the wrong place
