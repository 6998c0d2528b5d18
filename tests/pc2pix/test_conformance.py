"""The networks against the original's outputs under weights drawn by a written rule.

Tolerances: float64 sums of some
10^4 products of order one round at about 1e-12; 1e-9 leaves room for the depth of the networks.
The discriminator divides by singular values found by iteration, hence 1e-8.
"""

from __future__ import annotations

import json

import numpy as np
import pytest
import torch

from pc2pix.losses import chamfer
from pc2pix.model import Decoder, Discriminator, Encoder, Generator
from tests.bench.metrics.reference import REFERENCE

from .reference import fill_by_reference_rule

FILE = REFERENCE / "model_reference.json"


@pytest.fixture(scope="module")
def reference():
    return json.loads(FILE.read_text())


def filled(network_class, reference, name):
    entry = reference[name]
    network = network_class().double()
    fill_by_reference_rule(network, entry["seed"], entry["fill_order"])
    return network


def assert_image_like(nhwc, expected, tolerance):
    assert list(nhwc.shape) == expected["shape"]
    for statistic in ("mean", "std", "min", "max"):
        assert abs(getattr(nhwc, statistic)() - expected[statistic]) < tolerance, statistic
    for index, value in expected["samples"]:
        assert abs(nhwc[tuple(index)] - value) < tolerance, index


@pytest.fixture(scope="module")
def generator(reference):
    return filled(Generator, reference, "generator")


@pytest.mark.parametrize("case", ["inference", "training_batch_stats"])
def test_generator(reference, generator, case):
    generator.train(case == "training_batch_stats")
    inputs = (
        torch.from_numpy(np.random.default_rng(1).uniform(-1, 1, (3, 128))),
        torch.from_numpy(np.random.default_rng(2).standard_normal((3, 32))),
        torch.tensor([[0.25], [0.5], [0.75]], dtype=torch.float64),
        torch.tensor([[0.1], [0.35], [0.6]], dtype=torch.float64),
    )
    with torch.no_grad():
        images = generator(*inputs)
    assert_image_like(images.permute(0, 2, 3, 1).numpy(), reference["generator"][case], 1e-9)


def test_discriminator(reference):
    network = filled(Discriminator, reference, "discriminator")
    entry = reference["discriminator"]
    x = np.random.default_rng(4).uniform(-1, 1, (2, 128, 128, 3))
    images = torch.from_numpy(x).permute(0, 3, 1, 2)
    with torch.no_grad():
        before = [module.u.clone() for module in network.modules() if hasattr(module, "u")]
        evaluated = network.eval()(images[:1])
        after = [module.u for module in network.modules() if hasattr(module, "u")]
        assert all(torch.equal(a, b) for a, b in zip(before, after, strict=True))
        network.train()
        forwards = [network(images), network(images)]
    # evaluation iterates once from the stored u, as the first forward does, but stores nothing
    assert abs((evaluated.real_logit - forwards[0].real_logit[:1]).item()) < 1e-8
    cases = ("first_forward_1_power_iteration", "second_training_forward_2_power_iterations")
    for case, judged in zip(cases, forwards, strict=True):
        expected = entry[case]
        for actual, key in (
            (judged.real[:, 0], "real_fake"),
            (judged.code, "reco_pc_code"),
            (judged.elevation[:, 0], "reco_elev"),
            (judged.azimuth[:, 0], "reco_azim"),
        ):
            np.testing.assert_allclose(actual.numpy(), expected[key], rtol=0, atol=1e-8)


def test_autoencoder(reference):
    points = torch.from_numpy(np.random.default_rng(3).uniform(-1, 1, (2, 2048, 3)))
    encoder = filled(Encoder, reference, "encoder").eval()
    decoder = filled(Decoder, reference, "decoder").eval()
    with torch.no_grad():
        code = encoder(points)
        decoded = decoder(code)
        distance = chamfer(points, decoded)
    np.testing.assert_allclose(code.numpy(), reference["encoder"]["code"], rtol=0, atol=1e-9)
    assert_image_like(decoded.numpy(), reference["decoder"]["points"], 1e-9)
    expected = reference["chamfer_encoder_input_vs_decoder_output"]["value"]
    assert abs(distance.item() - expected) < 1e-9
