from __future__ import annotations

import pytest
import torch

from pc2pix.engine import UnfoldedGenerator
from pc2pix.model import Generator, ModelConfig
from pc2pix.weights import load_weights
from pc2pix.widen import widen


@pytest.fixture(scope="module")
def generator():
    return load_weights("chair").generator


def inputs(config, count=3):
    random = torch.Generator().manual_seed(1)
    code = torch.randn(1, config.latent_dim, generator=random)
    return code, *torch.rand(2, count, 1, generator=random)


@pytest.mark.parametrize("times", [1, 2, 4])
def test_the_wider_one_draws_the_same(generator, times):
    given = inputs(generator.config)
    expected = UnfoldedGenerator(generator)(*given)
    assert expected.std() > 0.05
    found = UnfoldedGenerator(widen(generator, times))(*given)
    # float32 sums of up to 4 x 2,304 products, through twelve layers; weights rounded once more
    torch.testing.assert_close(found, expected, rtol=0, atol=5e-5)


def test_it_is_as_wide_as_it_says(generator):
    wide = widen(generator, 4)
    assert wide.config.width == 1.0
    expected = {key: value.shape for key, value in Generator(wide.config).state_dict().items()}
    assert {key: value.shape for key, value in wide.state_dict().items()} == expected
    rows, columns = generator.dense.weight.shape
    assert wide.dense.weight.shape == (4 * rows, columns)
    assert not wide.training


def test_copies_are_read_with_different_weights(generator):
    wide = widen(generator, 2)
    read = wide.conv.weight.unflatten(1, (-1, 2))
    assert (read[:, :, 0] != read[:, :, 1]).all()
    torch.testing.assert_close(read.sum(dim=2), generator.conv.weight, rtol=1e-6, atol=1e-8)


def test_the_original_is_left_alone(generator):
    before = {key: value.clone() for key, value in generator.state_dict().items()}
    widen(generator, 2)
    for key, value in generator.state_dict().items():
        assert torch.equal(value, before[key])


def test_seeds(generator):
    a, b, c = (widen(generator, 2, seed).conv.weight for seed in (0, 0, 1))
    assert torch.equal(a, b)
    assert not torch.equal(a, c)


def test_what_cannot_be_widened():
    with pytest.raises(ValueError, match="times must be at least 1, got 0"):
        widen(Generator(ModelConfig(width=0.03, latent_dim=4)), 0)
    # 0.03 of 128 channels is 4 (3.84), 0.06 of them 8, but 0.03 of 1,024 is 31 and 0.06 is 61
    with pytest.raises(RuntimeError, match="size mismatch"):
        widen(Generator(ModelConfig(width=0.03, latent_dim=4)), 2)
