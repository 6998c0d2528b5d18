from __future__ import annotations

import pytest
import torch
from torch import nn
from torch.nn import functional

from pc2pix.autoencoder import PointNet, build_encoder
from pc2pix.model import (
    LITE,
    PAPER,
    Decoder,
    Discriminator,
    Encoder,
    Generator,
    ModelConfig,
    SpectralConv2d,
    SpectralLinear,
    upsample_then_conv,
)
from tests.learning.trainings import TINY


def counts(network_class, config):
    with torch.device("meta"):
        network = network_class(config)
    trainable = sum(p.numel() for p in network.parameters())
    stored = {k: v for k, v in network.named_buffers() if not k.endswith("num_batches_tracked")}
    return trainable, sum(b.numel() for b in stored.values())


@pytest.mark.parametrize(
    ("network_class", "latent_dim", "trainable", "non_trainable"),
    [
        (Generator, 32, 32_707_843, 9_984),
        (Generator, 512, 40_572_163, 9_984),
        (Discriminator, 32, 50_254_819, 12_387),
        (Discriminator, 512, 50_746_819, 12_867),
        (Encoder, 32, 1_448_798, 5_534),
        (Encoder, 512, 5_381_438, 5_534),
        (Decoder, 32, 8_430_592, 0),
        (Decoder, 512, 8_922_112, 0),
    ],
)
def test_paper_width_has_the_original_number_of_parameters(
    network_class, latent_dim, trainable, non_trainable
):
    assert counts(network_class, ModelConfig(latent_dim=latent_dim)) == (trainable, non_trainable)


def test_constructors_default_to_the_paper_and_lite_is_a_quarter():
    with torch.device("meta"):
        for network_class in (Generator, Discriminator, Encoder, Decoder):
            assert network_class().config == PAPER == ModelConfig(1.0, 32)
        generator = Generator(LITE)
        encoder = Encoder(LITE)
    assert generator.dense.in_features == 128 + 32 + 2
    assert [b.conv1.in_channels for b in generator.blocks] == [256, 256, 128, 64, 32]
    assert generator.conv.in_channels == 16
    assert encoder.branches[0][0].conv.out_channels == 16


@pytest.mark.parametrize(
    ("field", "value"),
    [("width", 0.0), ("width", -1.0), ("latent_dim", 0), ("encoder", "x"), ("azimuth", "degrees")],
)
def test_config_refuses(field, value):
    with pytest.raises(ValueError, match=f"{field} must be .*, got {value!r}"):
        ModelConfig(**{field: value})


def test_shapes_and_ranges():
    torch.manual_seed(0)
    generator, discriminator = Generator(TINY), Discriminator(TINY)
    angles = torch.rand(2, 3, 1)
    images = generator(torch.rand(3, 128), torch.randn(3, 4), *angles)
    assert images.shape == (3, 3, 128, 128)
    assert images.abs().max() <= 1
    judged = discriminator(images)
    assert [tuple(t.shape) for t in judged] == [(3, 1), (3, 4), (3, 1), (3, 1)]
    for probability in (judged.real, judged.elevation, judged.azimuth):
        assert ((probability > 0) & (probability < 1)).all()
    cloud = Decoder(TINY)(Encoder(TINY)(torch.rand(3, 2048, 3)))
    assert cloud.shape == (3, 2048, 3)
    assert cloud.abs().max() <= 1


def test_initial_state_is_glorot_with_zero_biases():
    torch.manual_seed(0)
    generator = Generator(TINY)
    conv = generator.blocks[0].conv1
    bound = (6 / (9 * (conv.in_channels + conv.out_channels))) ** 0.5
    assert 0.95 * bound < conv.weight.abs().max() <= bound
    assert all((m.bias == 0).all() for m in generator.modules() if isinstance(m, nn.Conv2d))


def test_fused_up_and_down_sampling():
    """Up-sampling then convolution; convolution then pooling."""
    torch.manual_seed(0)
    x = torch.randn(2, 3, 6, 4, dtype=torch.float64)
    conv = nn.Conv2d(3, 5, 3, padding=1).double()
    expected = conv(functional.interpolate(x, scale_factor=2.0))
    assert (upsample_then_conv(x, conv) - expected).abs().max() < 1e-13  # ~30 products
    conv = SpectralConv2d(3, 5, 3).double().eval()
    assert (conv.then_pool(x) - functional.avg_pool2d(conv(x), 2)).abs().max() < 1e-13


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


POINTNET = ModelConfig(0.0625, 8, "pointnet", "sine-cosine")


def test_pointnet_depends_on_neither_order_nor_repetition():
    encoder = build_encoder(POINTNET)
    assert isinstance(encoder, PointNet)
    clouds = torch.randn(2, 300, 3, generator=torch.Generator().manual_seed(0))
    code = encoder(clouds)
    assert code.shape == (2, 8)
    # sums in another order: some hundred roundings of 6e-8
    torch.testing.assert_close(encoder(clouds.flip(1)), code, rtol=1e-5, atol=1e-5)
    torch.testing.assert_close(encoder(clouds.repeat(1, 3, 1)), code, rtol=1e-5, atol=1e-5)


def test_sine_and_cosine_make_the_generator_periodic_and_the_discriminator_answer_twice():
    torch.manual_seed(0)
    generator, discriminator = Generator(POINTNET).eval(), Discriminator(POINTNET)
    noise, code = torch.randn(1, 128), torch.randn(1, 8)
    elevation = torch.tensor([[0.5]])
    left, right, front = (
        generator(noise, code, elevation, torch.tensor([[a]])) for a in (0.0, 1.0, 0.5)
    )
    torch.testing.assert_close(left, right, atol=1e-5, rtol=0)
    assert (left - front).abs().max() > 1e-3
    assert discriminator(left).azimuth.shape == (1, 2)
