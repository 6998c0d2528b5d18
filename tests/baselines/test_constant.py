from __future__ import annotations

import hashlib

import numpy as np
import pytest
from PIL import Image

from baselines.constant import Constant, read_image
from bench.catalogue.methods import find_method
from data_prep.failures import BadInput
from data_prep.rendering.images import to_uint8
from data_prep.scene import PointCloud, View

VIEWS = [View(0, 0), View(100, -40), View(-180, 90)]


@pytest.mark.parametrize("points", [np.zeros((0, 3)), np.full((5, 3), np.nan)])
def test_the_same_image_whatever_the_cloud_and_view(points: np.ndarray) -> None:
    image = np.random.default_rng(0).integers(0, 256, (128, 128, 3), np.uint8)
    method = Constant(image)
    images = method.draw(method.prepare(PointCloud(points)), VIEWS)
    assert images.dtype == np.float32
    np.testing.assert_array_equal(to_uint8(images), np.stack([image] * 3))
    assert method.draw(None, []).shape == (0, 128, 128, 3)


def test_the_bundled_image() -> None:
    image = read_image()
    method = find_method("constant")
    assert method.identity() == f"picture {hashlib.sha256(image.tobytes()).hexdigest()}"
    drawn = method.load("cpu").draw(None, VIEWS[:1], np.random.default_rng(0))
    np.testing.assert_array_equal(to_uint8(drawn)[0], image)
    assert image.min() > 200  # SSIM punishes any contrast in the wrong place


def test_images_that_cannot_be_used(tmp_path) -> None:
    path = tmp_path / "constant.png"
    for _ in ("missing", "damaged"):
        with pytest.raises(BadInput, match=r"no readable image .* 'bench train constant'"):
            read_image(path)
        path.write_bytes(b"nothing")
    Image.new("RGB", (64, 128)).save(path)
    with pytest.raises(BadInput, match="64 x 128, expected 128 x 128; reinstall"):
        read_image(path)
