from __future__ import annotations

import re

import numpy as np
import pytest

from bench.catalogue import loaders
from bench.catalogue.methods import find_method
from data_prep.scene import PointCloud, View
from learning.weights import file_sha256

VIEWS = [View(10.0 * i, 5.0 * i) for i in range(3)]


def test_grey_methods_keep_the_keys_of_their_jobs():
    """Their tensors are those of the files that they had."""
    kept = {
        "splat-net@grey": "0445cfb77209b1c073dd734f0fe6b3307884d28faf3f498a5d50375f5c589416",
        "splat-net@tiny-grey": "d81ce265948ae583db8aec0a6d9d075a6602b1bcde7ab1db21b5685c17b6010c",
        "fused-net@grey": "bb4d03c1b3594fee5d69278ea889ffa4bc84b923a1a3cfbe0906c02088cc6b0a",
    }
    for name, checksum in kept.items():
        identity = find_method(name).identity()
        assert re.search("weights ([0-9a-f]{64})", identity).group(1) == checksum
        assert file_sha256(find_method(name).weights_file()) not in identity
    coloured = find_method("splat-net")
    assert file_sha256(coloured.weights_file()) in coloured.identity()


@pytest.mark.slow
def test_the_paper_width_draws_the_same():
    rng = np.random.default_rng(0)
    cloud = PointCloud(rng.normal(size=(2048, 3)) / 4)
    drawn = []
    for method in ("pc2pix", "pc2pix@paper"):
        renderer = find_method(method).load("cpu")
        drawn.append(renderer.draw(renderer.prepare(cloud, rng), VIEWS, rng))
    # float32 in another order, as in test_widen
    assert np.abs(drawn[0] - drawn[1]).max() < 1e-4


def test_the_paper_width_is_the_papers():
    renderer = loaders.widened("cpu")
    assert renderer.generator.config.width == 1.0
