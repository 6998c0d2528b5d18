"""Our step against one that shares no code with it: same losses, same gradients."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from learning.training_loop import seeded
from pc2pix.model import Encoder, ModelConfig
from pc2pix.train_gan import GanConfig, _GanTrainer
from studies.plain_loop import PlainLoop, Target
from studies.training_speed import CPU, make_data, our_step, plain_step
from studies.turns import in_turns

TINY = ModelConfig(width=0.0625, latent_dim=4)


@pytest.fixture(scope="module")
def both():
    """Both steps from the same weights and batch; no weight moves, for the learning rates are 0."""
    torch.manual_seed(0)
    config = GanConfig(model=TINY, batch=3, generator_lr=0.0, discriminator_lr=0.0)
    ours = _GanTrainer(make_data(), seeded(0, lambda: Encoder(TINY)), config, CPU)
    for module in ours.discriminator.modules():
        if hasattr(module, "u"):
            # where power iteration ends: ours takes one step for both halves, the plain one two
            module.u.copy_(torch.linalg.svd(module.weight.detach().flatten(1))[0][:, 0])
    plain = PlainLoop(TINY.width, TINY.latent_dim, 0.0, 0.0)
    plain.generator.load_state_dict(ours.generator.state_dict())
    plain.discriminator.load_state_dict(ours.discriminator.state_dict())
    before = ours.random.get_state()
    images, shown = ours._draw_real()
    noise, wanted = zip(*(ours._draw_fake() for _ in range(2)), strict=True)
    ours.random.set_state(before)
    losses = ours.take_step()
    actual = plain.step(
        images.contiguous(), Target(*shown), noise, tuple(Target(*some) for some in wanted)
    )
    return ours, losses, plain, actual


def test_the_losses_are_the_same(both):
    _, losses, _, actual = both
    # measured: 3e-7
    np.testing.assert_allclose(actual, (losses["d_total"], losses["g_total"]), rtol=3e-6)


@pytest.mark.parametrize("network", ["generator", "discriminator"])
def test_the_gradients_are_the_same(both, network):
    ours, _, plain, _ = both
    expected = dict(getattr(ours, network).named_parameters())
    actual = dict(getattr(plain, network).named_parameters())
    assert expected.keys() == actual.keys()
    largest = max(p.grad.abs().max() for p in expected.values())
    for name, parameter in expected.items():
        # a bias before BatchNorm has no gradient but rounding, hence the second scale; there the
        # difference is 5e-4 of it, elsewhere 2e-5
        scale = max(parameter.grad.abs().max(), 1e-3 * largest)
        difference = (actual[name].grad - parameter.grad).abs().max()
        assert difference < 2e-3 * scale, name


def test_the_benchmark_runs():
    data = make_data()
    steps = [plain_step(data, TINY, 2), our_step(data, TINY, "acgan-code", 2, "bfloat16")]
    plain, ours = in_turns(steps, 2)
    assert len(plain) == len(ours) == 2
    assert min(plain + ours) > 0
