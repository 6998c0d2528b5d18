from __future__ import annotations

import pytest
import torch

from pc2pix.model import Generator, ModelConfig
from pc2pix.weights import load_weights
from pc2pix.widen import widen

from .networks import drawn


@pytest.fixture(scope="module")
def generator():
    return load_weights("chair").generator


@pytest.mark.parametrize("times", [1, 2, 4])
def test_the_wider_one_draws_the_same(generator, times):
    random = torch.Generator().manual_seed(1)
    code = torch.randn(1, generator.config.latent_dim, generator=random)
    given = code, *torch.rand(2, 3, 1, generator=random)
    expected = drawn(generator, *given)
    assert expected.std() > 0.05
    wide = widen(generator, times)
    assert not wide.training
    assert wide.config.width == 0.25 * times
    rows, columns = generator.dense.weight.shape
    assert wide.dense.weight.shape == (times * rows, columns)
    # float32 sums of up to 4 x 2,304 products, through twelve layers; weights rounded once more
    torch.testing.assert_close(drawn(wide, *given), expected, rtol=0, atol=5e-5)


def test_copies_are_read_with_different_weights_of_the_seed(generator):
    before = {key: value.clone() for key, value in generator.state_dict().items()}
    first, same, other = (widen(generator, 2, seed).conv.weight for seed in (0, 0, 1))
    assert torch.equal(first, same)
    assert not torch.equal(first, other)
    read = first.unflatten(1, (-1, 2))
    assert (read[:, :, 0] != read[:, :, 1]).all()
    torch.testing.assert_close(read.sum(dim=2), generator.conv.weight, rtol=1e-6, atol=1e-8)
    assert all(torch.equal(value, before[key]) for key, value in generator.state_dict().items())


def test_what_cannot_be_widened():
    with pytest.raises(ValueError, match="times must be at least 1, got 0"):
        widen(Generator(ModelConfig(width=0.03, latent_dim=4)), 0)
    # 0.03 of 128 channels is 4 (3.84), 0.06 of them 8, but 0.03 of 1,024 is 31 and 0.06 is 61
    with pytest.raises(RuntimeError, match="size mismatch"):
        widen(Generator(ModelConfig(width=0.03, latent_dim=4)), 2)
