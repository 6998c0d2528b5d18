from __future__ import annotations

import copy

import pytest
import torch
from torch.nn import functional

from pc2pix.engine import FoldedGenerator, NineProducts, Phases, Rows, fold
from pc2pix.model import Generator, ModelConfig

from .networks import drawn, live_in

# blocks end with 128, 64, 32, 16 and 8 channels: every form of up-sampling, in both precisions
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
    actual = fold(generator)(*given)
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
    actual = fold(generator, "bfloat16")(*given)
    assert actual.dtype == torch.float32
    apart = (actual - expected).abs()
    # half a unit of 8 digits is 2e-3 of a value; fifteen roundings in a row, added as errors do
    assert 1e-4 < apart.mean() < 2e-3 * 15**0.5
    assert (actual - expected).mean().abs() < 1e-3  # to nearest: no drift


@pytest.mark.parametrize("form", [Phases, Rows, NineProducts])
@pytest.mark.parametrize("shape", [(2, 3, 4, 4), (1, 5, 6, 3), (1, 2, 1, 1)])
def test_every_form_of_upsampling(form, shape):
    torch.manual_seed(0)
    channels = shape[1]
    y, shortcut = torch.randn(2, *shape, dtype=torch.float64)
    kernel = torch.randn(channels, channels, 3, 3, dtype=torch.float64)
    conv = form(kernel, shape, torch.float64)
    actual = conv(y, shortcut.repeat(1, conv.shortcuts, 1, 1))
    expected = functional.conv2d(functional.interpolate(y, scale_factor=2.0), kernel, padding=1)
    expected += functional.interpolate(shortcut, scale_factor=2.0)
    assert actual.is_contiguous(memory_format=torch.channels_last)
    assert (actual - expected).abs().max() < 1e-13  # some 40 products


@pytest.mark.parametrize("precision", ["float32", "bfloat16"])
def test_groups_are_whole_and_in_order(precision):
    generator = lived_in(TURNING)
    code, elevation01, azimuth01, noise = inputs(TURNING, 5)
    grouped = FoldedGenerator(generator, precision, group_bytes=2 * 2 * 128 * 128 * 2 * 2)
    assert grouped.for_many.groups[-1] in (2, 4)  # float32 and bfloat16; neither divides 5
    assert grouped.for_many.groups[0] > 5
    assert set(grouped.for_one.groups) == {1}
    together = grouped(code, elevation01, azimuth01, noise)
    # alone, other kernels may serve: float32 as above, bfloat16 by units of 1/256
    atol = 1e-5 if precision == "float32" else 0.05
    for i in range(5):
        (alone,) = grouped(
            *(x[i : i + 1] if len(x) > 1 else x for x in (code, elevation01, azimuth01, noise))
        )
        torch.testing.assert_close(together[i], alone, rtol=0, atol=atol)
    assert (together[0] - together[1]).abs().max() > 0.1


def test_what_is_not_finite_stays_so():
    generator = lived_in(SMALL)
    for layer in (generator.dense, generator.blocks[1].conv1, generator.blocks[4].conv2):
        broken = copy.deepcopy(generator)
        twin = dict(zip(generator.modules(), broken.modules(), strict=True))[layer]
        twin.bias[0] = torch.nan
        assert fold(broken)(*inputs(SMALL, 1)).isnan().any()


def test_other_precisions_are_refused():
    with pytest.raises(ValueError, match="float32 or bfloat16, got 'float16'"):
        fold(Generator(TURNING), "float16")  # pyright: ignore[reportArgumentType]
