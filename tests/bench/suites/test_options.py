"""Options that a suite with a protocol of its own cannot follow are refused before it begins."""

from __future__ import annotations

from dataclasses import replace

import pytest

from bench.running.options import Options
from bench.suites.latent import run as latent
from bench.suites.speed import run as speed
from bench.suites.stability import run as stability
from data_prep.failures import BadInput

SUITES = {"latent": latent, "speed": speed, "stability": stability}


@pytest.mark.parametrize(
    ("suite", "option", "value", "message"),
    [
        ("latent", "conditions", ("512",), "has no meaning for the suite latent, clouds have"),
        ("latent", "views", 3, "has no meaning for the suite latent, everything is seen from"),
        ("latent", "workers", 2, "has no meaning for the suite latent, it works in one process"),
        ("latent", "inception_weights", "x", "has no meaning for the suite latent"),
        ("latent", "limit", 0, "--limit 0: must be at least 1"),
        ("latent", "methods", ("splat",), "has no code to do arithmetic with; use pc2pix"),
        ("latent", "methods", ("pc2pix@no.safetensors",), "no.safetensors: no such weights file"),
        ("latent", "dataset", "folder:{}", "which only procedural ones have"),
        ("speed", "workers", 2, "--workers: has no meaning for the suite speed"),
        ("speed", "inception_weights", "download", "--inception-weights: has no meaning"),
        ("speed", "limit", 0, "--limit 0: must be at least 1"),
        ("speed", "views", 0, "--views 0: must be at least 1"),
        ("speed", "methods", ("splot",), "unknown method 'splot'"),
        ("speed", "conditions", ("2049",), "unknown condition '2049'"),
        ("speed", "dataset", "nowhere", "unknown dataset 'nowhere'"),
        ("stability", "conditions", ("2048",), "--conditions: has no meaning"),
        ("stability", "views", 3, "--views: has no meaning"),
        ("stability", "limit", 1, "--limit: has no meaning"),
        ("stability", "inception_weights", "download", "--inception-weights: has no meaning"),
        ("stability", "dataset", "procedural:validation", "--dataset procedural:validation: the"),
        ("stability", "methods", ("splot",), "unknown method 'splot'"),
    ],
)
def test_options_without_a_meaning(tmp_path, suite, option, value, message):
    (tmp_path / "a.obj").touch()
    if option == "dataset":
        value = value.format(tmp_path)
    options = replace(Options(suite, out=tmp_path / "run"), **{option: value})
    with pytest.raises(BadInput, match=message):
        SUITES[suite].run(options)
    assert not (tmp_path / "run").exists()
