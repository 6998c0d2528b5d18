"""Our step against one that shares no code with it: same losses, same gradients."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from learning.training_loop import seeded
from pc2pix.model import Encoder, ModelConfig
from pc2pix.train_gan import GanConfig, _GanTrainer
from pc2pix.training_data import GanData

from .plain import PlainDiscriminator, PlainGenerator, Target, loss

TINY = ModelConfig(width=0.0625, latent_dim=4)


def noise_in_the_shape_of_a_training_set():
    rng = np.random.default_rng(0)
    return GanData(
        images=rng.integers(0, 256, (8, 2, 128, 128, 3), dtype=np.uint8),
        azimuth_deg=rng.uniform(-180, 180, (8, 2)),
        elevation_deg=rng.uniform(-40, 40, (8, 2)),
        clouds=rng.uniform(-0.5, 0.5, (8, 2048, 3)).astype(np.float32),
    )


@pytest.fixture(scope="module")
def both():
    """Both steps from the same weights and batch; no weight moves, for the learning rates are 0."""
    torch.manual_seed(0)
    config = GanConfig(model=TINY, batch=3, generator_lr=0.0, discriminator_lr=0.0)
    encoder = seeded(0, lambda: Encoder(TINY))
    ours = _GanTrainer(noise_in_the_shape_of_a_training_set(), encoder, config, torch.device("cpu"))
    for module in ours.discriminator.modules():
        if hasattr(module, "u"):  # where power iteration ends
            module.u.copy_(torch.linalg.svd(module.weight.detach().flatten(1))[0][:, 0])
    generator = PlainGenerator(TINY.width, TINY.latent_dim)
    generator.load_state_dict(ours.generator.state_dict())
    discriminator = PlainDiscriminator(TINY.width, TINY.latent_dim)
    weights = ours.discriminator.state_dict()
    discriminator.load_state_dict({k: v for k, v in weights.items() if not k.endswith(".u")})

    before = ours.random.get_state()
    images, shown = ours._draw_real()
    noise, wanted = zip(*(ours._draw_fake() for _ in range(2)), strict=True)
    ours.random.set_state(before)
    losses = ours.take_step()

    asked = [Target(*targets) for targets in wanted]
    drawn = generator(noise[0], asked[0]).detach()
    d_loss = loss(discriminator(images), Target(*shown), 1.0)
    d_loss = d_loss + loss(discriminator(drawn), asked[0], 0.0)
    d_loss.backward()
    discriminator.requires_grad_(False)
    g_loss = loss(discriminator(generator(noise[1], asked[1])), asked[1], 1.0)
    g_loss.backward()
    plain = {"generator": generator, "discriminator": discriminator}
    return ours, losses, plain, (d_loss.item(), g_loss.item())


def test_the_losses_are_the_same(both):
    _, losses, _, actual = both
    # measured: 3e-7
    np.testing.assert_allclose(actual, (losses["d_total"], losses["g_total"]), rtol=3e-6)


@pytest.mark.parametrize("network", ["generator", "discriminator"])
def test_the_gradients_are_the_same(both, network):
    ours, _, plain, _ = both
    expected = dict(getattr(ours, network).named_parameters())
    actual = dict(plain[network].named_parameters())
    assert expected.keys() == actual.keys()
    largest = max(p.grad.abs().max() for p in expected.values())
    for name, parameter in expected.items():
        # a bias before BatchNorm has no gradient but rounding, hence the second scale; there the
        # difference is 5e-4 of it, elsewhere 2e-5
        scale = max(parameter.grad.abs().max(), 1e-3 * largest)
        difference = (actual[name].grad - parameter.grad).abs().max()
        assert difference < 2e-3 * scale, name
