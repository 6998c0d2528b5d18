from __future__ import annotations

import pytest
import torch

from baselines.splat_net.network import SplatNet, composite
from baselines.splat_net.weights import KIND, export, load_weights
from data_prep.failures import BadInput
from learning import checkpoint
from tests.learning.trainings import SMALL


def test_a_file_of_one_head_draws_what_the_trained_network_draws_with_it(trained, tmp_path):
    state, _, _ = checkpoint.load(trained, KIND)
    both = SplatNet(SMALL).eval().requires_grad_(False)
    both.load_state_dict(checkpoint.sub_state(state, "average"))
    for value in both.parameters():
        if value.dim() > 1:
            value.copy_(value.half())  # as kernels are stored
    random = torch.Generator().manual_seed(0)
    given = torch.rand(2, SMALL.inputs.channels, 64, 64, generator=random)
    alpha, images = composite(both(given), ("colour", "grey"))
    for head, expected in zip(("colour", "grey"), images, strict=True):
        export(trained, tmp_path / head, head)
        loaded = load_weights(tmp_path / head)
        assert loaded.network.config.heads == loaded.card["network"]["heads"] == (head,)
        assert loaded.network.config.widths == SMALL.widths
        found_alpha, (actual,) = composite(loaded.network(given), (head,))
        # the same sums, of some 9 x 12 products, by other kernels: some 1e-7
        torch.testing.assert_close(actual, expected, rtol=0, atol=1e-5)
        torch.testing.assert_close(found_alpha, alpha, rtol=0, atol=1e-5)
    assert (images[0] - images[1]).abs().max() > 1e-3
    assert loaded.card["steps"] == 2
    rates = "falling linearly from 2e-06 at step 1 to 1e-06 at step 2"  # of 2e-3, over 2,000 steps
    assert loaded.card["learning_rates"] == rates


def test_a_head_that_is_not_there(trained, tmp_path):
    with pytest.raises(BadInput, match=r"has no head 'silver'; give one of colour, grey") as error:
        export(trained, tmp_path / "w", "silver")
    assert str(error.value).startswith(f"{trained}: ")
    assert not list(tmp_path.iterdir())
