"""The features that trainings compare."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from baselines.splat_net.losses import OBJECTIVES
from bench.metrics.inception_weights import WeightsUnavailable
from bench.training.networks import compared_features
from data_prep.failures import BadInput


def _absent() -> Path:
    raise WeightsUnavailable("the package efficientnet is not installed; install it")


def test_only_an_objective_that_compares_features_asks_for_their_weights() -> None:
    for name in OBJECTIVES.keys() - {"perceptual"}:
        assert compared_features(name, _absent) is None
    assert compared_features("unknown", _absent) is None
    with pytest.raises(BadInput, match=r"--objective perceptual: the package .* install it"):
        compared_features("perceptual", _absent)


def test_the_features_are_maps_of_four_sizes() -> None:
    maps = compared_features("perceptual")
    assert maps is not None
    sizes = [tuple(found.shape) for found in maps(torch.full((2, 3, 128, 128), 255.0))]
    assert sizes == [(2, 32, 64, 64), (2, 24, 32, 32), (2, 40, 16, 16), (2, 80, 8, 8)]
