from __future__ import annotations

import pytest
import torch

from pc2pix.model import Generator, ModelConfig
from pc2pix.weights import load_weights
from pc2pix.widen import widen

from .networks import drawn


def test_a_wider_one_draws_the_same_by_copies_of_different_weights():
    generator = load_weights("chair").generator
    random = torch.Generator().manual_seed(1)
    code = torch.randn(1, generator.config.latent_dim, generator=random)
    given = code, *torch.rand(2, 2, 1, generator=random)
    expected = drawn(generator, *given)
    assert expected.std() > 0.05
    wide, same, other = (widen(generator, 2, seed) for seed in (0, 0, 1))
    assert wide.config.width == 0.5
    rows, columns = generator.dense.weight.shape
    assert wide.dense.weight.shape == (2 * rows, columns)
    # float32 sums of up to 2 x 2,304 products, through twelve layers; weights rounded once more
    torch.testing.assert_close(drawn(wide, *given), expected, rtol=0, atol=5e-5)
    assert torch.equal(wide.conv.weight, same.conv.weight)
    assert not torch.equal(wide.conv.weight, other.conv.weight)
    read = wide.conv.weight.unflatten(1, (-1, 2))
    assert (read[:, :, 0] != read[:, :, 1]).all()
    torch.testing.assert_close(read.sum(dim=2), generator.conv.weight, rtol=1e-6, atol=1e-8)


def test_what_cannot_be_widened():
    small = Generator(ModelConfig(width=0.03, latent_dim=4))
    with pytest.raises(ValueError, match="times must be at least 1, got 0"):
        widen(small, 0)
    # 0.03 of 128 channels is 4 (3.84), 0.06 of them 8, but 0.03 of 1,024 is 31 and 0.06 is 61
    with pytest.raises(RuntimeError, match="size mismatch"):
        widen(small, 2)
