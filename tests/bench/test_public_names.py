"""The names that other packages and scripts import."""

from __future__ import annotations

from importlib import import_module

import pytest

import bench
from bench.draw.points import draw_cloud


def test_the_same_object_by_both_names():
    for module, name, inside in (
        ("bench.methods", "Method", "bench.catalogue.methods"),
        ("bench.image_metric", "ImageMetric", "bench.catalogue.plugins"),
        ("bench.render_cloud", "draw_file", "bench.draw.cloud"),
        ("bench.inception", "FidInception", "bench.metrics.inception"),
        ("bench.metrics", "lpips", "bench.metrics.lpips_network"),
        ("bench.metrics", "ssim", "bench.metrics.structural_similarity"),
        ("bench.metrics", "psnr", "bench.metrics.peak_signal_to_noise"),
        ("bench.metrics", "frechet_distance", "bench.metrics.frechet"),
    ):
        assert getattr(import_module(module), name) is getattr(import_module(inside), name)
    assert bench.draw_cloud is draw_cloud
    with pytest.raises(AttributeError, match="module 'bench' has no attribute 'nothing'"):
        bench.nothing  # noqa: B018
    for module in ("methods", "metrics"):
        with pytest.raises(ImportError, match="nothing"):
            exec(f"from bench.{module} import nothing")
