"""A step of the paper's training, written down plainly: same losses, same gradients.

Real and drawn images are judged in passes of their own; losses are those of the original code. The
networks are held to its outputs in `test_conformance`.
"""

from __future__ import annotations

import copy
import math

import numpy as np
import torch
from torch.nn.functional import binary_cross_entropy_with_logits, l1_loss

from learning.training_loop import seeded
from pc2pix.model import Encoder
from pc2pix.train_gan import GanTrainer
from pc2pix.training_configs import GanConfig
from tests.learning.trainings import TINY

from .conftest import many_objects


def angle_loss(recognised, wanted, range_rad):
    """Return the paper's L_theta, in radians."""
    delta = range_rad * (wanted - recognised)
    return torch.atan2(torch.sin(delta), torch.cos(delta)).abs().mean()


def loss(judged, wanted, label):
    """Return cross entropy and ten times each error, as in the original code."""
    return (
        binary_cross_entropy_with_logits(
            judged.real_logit, torch.full_like(judged.real_logit, label)
        )
        + 10 * l1_loss(judged.code, wanted.code)
        + 10 * angle_loss(judged.elevation, wanted.elevation01, 0.4444 * math.pi)
        + 10 * angle_loss(judged.azimuth, wanted.azimuth01, 2 * math.pi)
    )


def test_the_losses_and_gradients_are_those_of_a_plain_step():
    """Weights and batch are the same; no weight moves, for the learning rates are 0."""
    torch.manual_seed(0)
    config = GanConfig(model=TINY, batch=3, generator_lr=0.0, discriminator_lr=0.0)
    encoder = seeded(0, lambda: Encoder(TINY))
    ours = GanTrainer((many_objects(), encoder), config)
    for module in ours.discriminator.modules():
        if hasattr(module, "u"):  # where power iteration ends
            module.u.copy_(torch.linalg.svd(module.weight.detach().flatten(1))[0][:, 0])
    generator, discriminator = (copy.deepcopy(n) for n in (ours.generator, ours.discriminator))
    before = ours.random.get_state()
    images, shown = ours._draw_real()
    noise, wanted = zip(*(ours._draw_fake() for _ in range(2)), strict=True)
    ours.random.set_state(before)
    losses = ours.take_step()

    drawn = generator(noise[0], *wanted[0]).detach()
    d_loss = loss(discriminator(images), shown, 1.0)
    d_loss = d_loss + loss(discriminator(drawn), wanted[0], 0.0)
    d_loss.backward()
    discriminator.requires_grad_(False)
    g_loss = loss(discriminator(generator(noise[1], *wanted[1])), wanted[1], 1.0)
    g_loss.backward()
    plain = {"generator": generator, "discriminator": discriminator}
    actual = d_loss.item(), g_loss.item()
    # measured: 3e-7
    np.testing.assert_allclose(actual, (losses["d_total"], losses["g_total"]), rtol=3e-6)
    for network, other in plain.items():
        expected, found = (dict(n.named_parameters()) for n in (getattr(ours, network), other))
        assert expected.keys() == found.keys()
        largest = max(p.grad.abs().max() for p in expected.values())
        for name, parameter in expected.items():
            # a bias before BatchNorm has no gradient but rounding, hence the second scale; there
            # the difference is 5e-4 of it, elsewhere 2e-5
            scale = max(parameter.grad.abs().max(), 1e-3 * largest)
            assert (found[name].grad - parameter.grad).abs().max() < 2e-3 * scale, name
