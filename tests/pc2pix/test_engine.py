from __future__ import annotations

import copy

import pytest
import torch

from pc2pix.engine import FoldedGenerator
from pc2pix.model import Generator, ModelConfig

from .networks import drawn, live_in

SMALL = ModelConfig(width=0.125, latent_dim=4)
TURNING = ModelConfig(width=0.03, latent_dim=4, azimuth="sine-cosine")


def lived_in(config):
    torch.manual_seed(0)
    return live_in(Generator(config))


def inputs(config, count):
    random = torch.Generator().manual_seed(1)
    code = torch.randn(1, config.latent_dim, generator=random)
    angles = torch.rand(2, count, 1, generator=random)
    return code, *angles, 2 * torch.rand(count, 128, generator=random) - 1


@pytest.fixture(scope="module", params=[SMALL, TURNING], ids=["small", "turning"])
def generator(request):
    return lived_in(request.param)


@pytest.mark.parametrize("noisy", [False, True])
def test_float32_draws_what_the_generator_draws(generator, noisy):
    code, elevation01, azimuth01, noise = inputs(generator.config, 5)
    given = code, elevation01, azimuth01, noise if noisy else None
    actual = FoldedGenerator(generator)(*given)
    assert actual.shape == (5, 128, 128, 3)
    assert actual.dtype == torch.float32
    assert actual.is_contiguous()
    expected = drawn(generator, *given)
    assert expected.std() > 0.05
    # sums of some 1,000 float32 products in another order, through twelve layers: some 1e-6
    torch.testing.assert_close(actual, expected, rtol=0, atol=1e-5)


def test_bfloat16_is_bfloat16(generator):
    given = inputs(generator.config, 3)
    expected = drawn(generator, *given)
    actual = FoldedGenerator(generator, "bfloat16")(*given)
    assert actual.dtype == torch.float32
    apart = (actual - expected).abs()
    # half a unit of 8 digits is 2e-3 of a value; fifteen roundings in a row, added as errors do
    assert 1e-4 < apart.mean() < 2e-3 * 15**0.5
    assert (actual - expected).mean().abs() < 1e-3  # to nearest: no drift


def test_groups_are_whole_and_in_order():
    """Five images in groups of two, and one by one."""
    generator = lived_in(TURNING)
    given = inputs(TURNING, 5)
    grouped = FoldedGenerator(generator, "float32", group_bytes=2 * 2 * 128 * 128 * 2 * 4)
    together = grouped(*given)
    for i in range(5):
        (alone,) = grouped(*(x[i : i + 1] if len(x) > 1 else x for x in given))
        torch.testing.assert_close(together[i], alone, rtol=0, atol=1e-5)
    assert (together[0] - together[1]).abs().max() > 0.1


def test_what_is_not_finite_stays_so():
    broken = copy.deepcopy(lived_in(SMALL))
    broken.blocks[1].conv1.bias[0] = torch.nan
    assert FoldedGenerator(broken)(*inputs(SMALL, 1)).isnan().any()
