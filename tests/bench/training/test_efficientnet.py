"""EfficientNet-Lite0: its first maps by the values of its published weights."""

from __future__ import annotations

import pytest
import torch

from baselines.splat_net.losses import OBJECTIVES
from bench.metrics.inception_weights import WeightsUnavailable
from bench.training.efficientnet import WEIGHTS, EfficientNet, load_efficientnet
from bench.training.images import compared_features
from data_prep.failures import BadInput
from tests.bench.metrics.test_similarities import disc, noise

# Lengths of the four maps, and sums of their channels 5. By the network as modules of PyTorch from
# the table of the paper, in float64, on 2026-11-27; its 1,280 means were those of the code of the
# package efficientnet-lite-pytorch 0.1.0.
GOLDEN = {
    "noise 0": (
        noise(0, 128, 128, 3),
        [1038.032755679, 1680.455016419, 708.194895902, 402.401322792],
        [12077.273870668, -10765.663002258, -3673.972867473, 76.466846216],
    ),
    "disc 30 (200,80,40)": (
        disc(30, (200, 80, 40)),
        [934.138262659, 1016.467960582, 714.828205639, 386.082891429],
        [10892.965907836, 6867.447652378, -510.462085001, -93.449130971],
    ),
    "white": (
        disc(0, 255),
        [935.473730805, 915.809742987, 606.650648239, 340.466834503],
        [10672.098485804, 8064.882455070, -725.628658260, -50.302464668],
    ),
}


@pytest.mark.parametrize("name", GOLDEN)
def test_first_maps(name):
    image, lengths, sums = GOLDEN[name]
    pixels = torch.from_numpy(image).permute(2, 0, 1)[None].double()
    maps = EfficientNet(WEIGHTS.find(), torch.float64).first_maps(pixels)
    assert [float(m.detach().norm()) for m in maps] == pytest.approx(lengths, rel=1e-9)
    assert [float(m[0, 5].detach().sum()) for m in maps] == pytest.approx(sums, abs=1e-5)
    for exact, single in zip(
        maps, load_efficientnet(WEIGHTS.find()).first_maps(pixels), strict=True
    ):
        torch.testing.assert_close(single.double(), exact, rtol=0, atol=1e-3)


def test_gradients_reach_the_images():
    pixels = torch.from_numpy(noise(3, 1, 64, 96, 3)).permute(0, 3, 1, 2).double().requires_grad_()
    network = EfficientNet(WEIGHTS.find(), torch.float64)
    (gradient,) = torch.autograd.grad(network.first_maps(pixels)[-1].sum(), pixels)
    moved = torch.zeros_like(pixels)
    moved[0, 1, 30, 40] = 1e-3
    with torch.no_grad():
        up, down = (network.first_maps(pixels + sign * moved)[-1].sum() for sign in (1, -1))
    assert float(gradient[0, 1, 30, 40]) == pytest.approx(float(up - down) / 2e-3, rel=1e-5)


def test_only_an_objective_that_compares_features_asks_for_their_weights():
    def absent():
        raise WeightsUnavailable("the package efficientnet is not installed; install it")

    for name in (*OBJECTIVES.keys() - {"perceptual"}, "unknown"):
        assert compared_features(name, absent) is None
    with pytest.raises(BadInput, match=r"--objective perceptual: the package .* install it"):
        compared_features("perceptual", absent)
    maps = compared_features("perceptual")(torch.full((2, 3, 128, 128), 255.0))
    sizes = [(2, 32, 64, 64), (2, 24, 32, 32), (2, 40, 16, 16), (2, 80, 8, 8)]
    assert [tuple(found.shape) for found in maps] == sizes
