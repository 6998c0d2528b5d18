from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from baselines.fused_net.renderer import FusedNetRenderer
from baselines.reconstruction.stages import Reconstruction
from data_prep.datasets.registry import ProceduralObject
from data_prep.failures import StageFailure
from learning.weights import NetworkWeights
from tests.baselines.splat_net.conftest import lived_in
from tests.learning.trainings import SMALL


class Truth:
    """A reconstruction that knows the mesh of the chair; `prepare` counts its calls."""

    def __init__(self):
        self.calls = 0

    def prepare(self, cloud):
        self.calls += 1
        return Reconstruction(ProceduralObject("chair", "validation", 0).load(), ("known",))


class Failing:
    def prepare(self, cloud):
        raise StageFailure("alpha-wrap", "no faces")


def network(meshes, seed=0, heads=("grey",)):
    inputs = replace(SMALL.inputs, meshes=tuple(meshes))
    return lived_in(replace(SMALL, inputs=inputs, heads=heads))


def fused(net, methods, **options):
    """A renderer of a network by these methods in place of its own."""
    renderer = FusedNetRenderer(NetworkWeights(net.eval(), {}, ""), **options)
    assert tuple(renderer.methods) == tuple(methods)
    renderer.methods = dict(methods)
    return renderer


@pytest.fixture(scope="session")
def cloud():
    return ProceduralObject("chair", "validation", 0).cloud(np.random.default_rng(0), 512)
