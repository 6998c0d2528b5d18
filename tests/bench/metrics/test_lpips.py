"""LPIPS: conformance vectors and the published pair; refusals are in `test_extreme_inputs`."""

from __future__ import annotations

import hashlib
import json

import numpy as np
import pytest
import torch
from skimage.io import imread

from bench.metrics.lpips_network import Lpips, lpips
from bench.metrics.lpips_weights import (
    CHECKPOINTS,
    find_lpips_weights,
)
from tests.bench.metrics.reference import REFERENCE

FILE = REFERENCE / "lpips_reference.json"
NETS = {"alex": "alexnet", "vgg": "vgg16"}  # and their names in the reference
RAMP = np.tile(np.arange(128, dtype=np.uint8) * 2, (128, 1))


def noise(seed, *shape):
    return np.random.default_rng(seed).integers(0, 256, shape, dtype=np.uint8)


def disc(radius, value, row=64, column=64):
    rows, columns = np.mgrid[:128, :128]
    image = np.full((128, 128, 3), 255, np.uint8)
    image[(rows - row) ** 2 + (columns - column) ** 2 <= radius**2] = value
    return image


WHITE, GREY = disc(0, 255), disc(30, 150)
STACKED = np.stack([RAMP, RAMP.T, 255 - RAMP], 2)
PAIRS = {
    "white/white": (WHITE, WHITE),
    "white/black": (WHITE, np.zeros_like(WHITE)),
    "disc 30 grey 150/same moved 3 right": (GREY, disc(30, 150, column=67)),
    "disc 30 grey 150/white": (GREY, WHITE),
    "disc 30 grey 150/disc 30 (200,80,40)": (GREY, disc(30, (200, 80, 40))),
    "noise 0/noise 1": (noise(0, 128, 128, 3), noise(1, 128, 128, 3)),
    "ramp/transposed ramp": (STACKED, STACKED.transpose(1, 0, 2)),
    "ramp/noise 2": (STACKED, noise(2, 128, 128, 3)),
}


@pytest.fixture(scope="module")
def reference():
    return json.loads(FILE.read_text())


@pytest.fixture(scope="module", params=NETS)
def net(request):
    return request.param


# As the reference states: float64 on the float32 weights, and what float32 leaves of it.
@pytest.mark.parametrize(("single", "tolerance"), [(False, 1e-9), (True, 1e-5)])
def test_conformance(reference, net, single, tolerance):
    assert CHECKPOINTS[net].sha256 == reference["checkpoints"][NETS[net]]
    dtype = torch.float32 if single else torch.float64
    network = Lpips(find_lpips_weights(net), net, dtype)
    assert [case["case"] for case in reference["cases"]] == list(PAIRS)
    for case in reference["cases"]:
        a, b = PAIRS[case["case"]]
        assert [hashlib.sha256(x.tobytes()).hexdigest() for x in (a, b)] == case["sha256"]
        actual = lpips(a[None], b[None], net, single=single)
        assert actual.dtype == np.float64
        assert actual[0] == pytest.approx(case[f"lpips_{NETS[net]}"], rel=0, abs=tolerance)
        (features,) = network.encode(a[None]).features.numpy()
        stated = case[f"features_{NETS[net]}"]
        assert len(features) == stated["dim"]
        assert features[:5] == pytest.approx(stated["first5"], rel=0, abs=tolerance)
        assert np.linalg.norm(features) == pytest.approx(stated["norm"], rel=tolerance)


def test_the_published_pair(reference, net):
    ref, near, far = (
        imread(REFERENCE / "lpips" / f"ex_{name}.png")[None, ..., :3]
        for name in ("ref", "p1", "p0")
    )
    actual = [float(lpips(ref, other, net, single=True)[0]) for other in (far, near)]
    if net == "alex":
        assert [round(value, 3) for value in actual] == reference["published"]["alexnet"]
    assert [round(value, 4) for value in actual] == reference["published_reproduced_float32"][
        NETS[net]
    ]


def test_the_smallest_images():
    for net, side in (("alex", 31), ("vgg", 16)):
        a, b = noise(0, 1, side, side, 3), noise(1, 1, side, side, 3)
        assert 0 < lpips(a, b, net)[0] < 2
