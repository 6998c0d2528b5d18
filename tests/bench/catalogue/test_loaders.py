from __future__ import annotations

import numpy as np
import pytest

from bench.catalogue import loaders
from bench.catalogue.methods import find_method
from data_prep.scene import PointCloud, View

VIEWS = [View(10.0 * i, 5.0 * i) for i in range(3)]


@pytest.mark.slow
def test_the_paper_width_and_bfloat16_draw_the_same():
    rng = np.random.default_rng(0)
    cloud = PointCloud(rng.normal(size=(2048, 3)) / 4)
    drawn = {}
    for method in ("", "@bf16", "@paper", "@paper-bf16"):
        renderer = find_method(f"pc2pix{method}").load("cpu")
        drawn[method] = renderer.draw(renderer.prepare(cloud, rng), VIEWS, rng)
    for method, images in drawn.items():
        # float32 in another order, as in test_widen; bfloat16 rounds each of twelve layers to
        # 1/256 and its largest error may be many of its typical ones, so that its mean is asserted
        apart = np.abs(images - drawn[""])
        assert apart.mean() < 5e-3 if "bf16" in method else apart.max() < 1e-4, method
    assert (drawn[""] != drawn["@bf16"]).any()
    assert (drawn["@paper"] != drawn["@paper-bf16"]).any()


def test_the_paper_width_is_the_papers():
    renderer = loaders.widened("cpu")
    assert renderer.generator.config.width == 1.0
