"""Properties that `test_conformance` leaves open: initial weights, gradients, our variants."""

from __future__ import annotations

import torch
from torch import nn

from pc2pix.autoencoder import build_encoder
from pc2pix.model import Discriminator, Generator, ModelConfig, SpectralLinear
from tests.learning.trainings import PAIRED, TINY


def test_initial_state_is_glorot_with_zero_biases():
    torch.manual_seed(0)
    generator = Generator(TINY)
    conv = generator.blocks[0].conv1
    bound = (6 / (9 * (conv.in_channels + conv.out_channels))) ** 0.5
    assert 0.95 * bound < conv.weight.abs().max() <= bound
    assert all((m.bias == 0).all() for m in generator.modules() if isinstance(m, nn.Conv2d))


def test_spectral_norm_converges_to_the_largest_singular_value_and_has_its_gradient():
    torch.manual_seed(0)
    layer = SpectralLinear(7, 5).double()
    for _ in range(200):
        layer(torch.zeros(1, 7, dtype=torch.float64))
    layer.eval()
    with torch.no_grad():
        normalised = layer(torch.eye(7, dtype=torch.float64)) - layer.bias
    assert abs(torch.linalg.matrix_norm(normalised, 2).item() - 1) < 1e-6
    layer(torch.eye(7, dtype=torch.float64)).square()[0].sum().backward()
    weight = layer.weight.detach().clone().requires_grad_()
    plain = (weight / torch.linalg.matrix_norm(weight, 2)).T + layer.bias.detach()
    plain.square()[0].sum().backward()
    torch.testing.assert_close(layer.weight.grad, weight.grad, rtol=1e-6, atol=1e-9)


def test_spectral_norm_stays_float32_under_autocast():
    torch.manual_seed(0)
    layer, reference = SpectralLinear(64, 64), SpectralLinear(64, 64)
    reference.load_state_dict(layer.state_dict())
    x = torch.zeros(1, 64)
    reference(x)
    with torch.autocast("cpu", torch.bfloat16):
        layer(x)
    assert torch.equal(layer.u, reference.u)


def test_pointnet_depends_on_neither_order_nor_repetition():
    encoder = build_encoder(ModelConfig(0.0625, 8, "pointnet"))
    clouds = torch.randn(2, 300, 3, generator=torch.Generator().manual_seed(0))
    code = encoder(clouds)
    assert code.shape == (2, 8)
    # sums in another order: some hundred roundings of 6e-8
    torch.testing.assert_close(encoder(clouds.flip(1)), code, rtol=1e-5, atol=1e-5)
    torch.testing.assert_close(encoder(clouds.repeat(1, 3, 1)), code, rtol=1e-5, atol=1e-5)


def test_sine_and_cosine_make_the_generator_periodic_and_the_discriminator_answer_twice():
    torch.manual_seed(0)
    generator, discriminator = Generator(PAIRED).eval(), Discriminator(PAIRED)
    noise, code, elevation = torch.randn(1, 128), torch.randn(1, 4), torch.tensor([[0.5]])
    left, right, front = (
        generator(noise, code, elevation, torch.tensor([[a]])) for a in (0.0, 1.0, 0.5)
    )
    torch.testing.assert_close(left, right, atol=1e-5, rtol=0)
    assert (left - front).abs().max() > 1e-3
    assert discriminator(left).azimuth.shape == (1, 2)
