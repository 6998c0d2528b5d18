from __future__ import annotations

import pytest
import torch

from baselines.splat_net.network import composite
from baselines.splat_net.train import KIND
from baselines.splat_net.weights import (
    Weights,
    export,
    load_weights,
)
from data_prep.failures import BadInput
from learning import checkpoint
from learning.weights import file_sha256, objective_of

from .conftest import SMALL


@pytest.fixture(scope="module")
def weights_file(trained, tmp_path_factory):
    path = tmp_path_factory.mktemp("weights") / "small.safetensors"
    export(trained, path, "colour")
    return path


def one_line(error):
    message = str(error.value)
    assert "\n" not in message
    return message


def test_round_trip(trained, tmp_path):
    path = tmp_path / "w.safetensors"
    sha256 = export(trained, path, "grey")
    loaded = load_weights(path)
    assert isinstance(loaded, Weights)
    assert loaded.sha256 == sha256 == file_sha256(path)
    assert loaded.card["steps"] == 2
    assert loaded.card["objective"] == objective_of(path) == "l1"
    rates = "falling linearly from 2e-06 at step 1 to 1e-06 at step 2"  # of 2e-3, over 2,000 steps
    assert loaded.card["learning_rates"] == rates
    assert loaded.card["network"]["heads"] == ("grey",)
    assert loaded.network.config.heads == ("grey",)
    assert loaded.network.config.widths == SMALL.widths
    assert loaded.network.config.inputs == SMALL.inputs
    assert not loaded.network.training
    assert not any(p.requires_grad for p in loaded.network.parameters())
    state, _, _ = checkpoint.load(trained, KIND)
    for key, value in loaded.network.state_dict().items():
        if not key.endswith("num_batches_tracked"):
            original = state[f"average.{key}"]
            if key.startswith("last."):
                original = original[[0, 4]]  # alpha, red, green, blue, grey
            # float16 keeps 11 bits; below 6e-5 it is subnormal with a spacing of 6e-8
            tolerance = 0 if value.dim() == 1 else 2**-11
            torch.testing.assert_close(value, original, rtol=tolerance, atol=3e-8)
    assert [p.name for p in tmp_path.iterdir()] == ["w.safetensors"]


def test_a_file_of_one_head_draws_what_the_trained_network_draws_with_it(trained, tmp_path):
    from baselines.splat_net.network import SplatNet

    state, _, _ = checkpoint.load(trained, KIND)
    both = SplatNet(SMALL).eval().requires_grad_(False)
    both.load_state_dict(checkpoint.sub_state(state, "average"))
    random = torch.Generator().manual_seed(0)
    given = torch.rand(2, SMALL.inputs.channels, 64, 64, generator=random)
    # kernels are stored in float16: here, so that only the heads are compared
    for value in both.parameters():
        if value.dim() > 1:
            value.copy_(value.half())
    alpha, images = composite(both(given), ("colour", "grey"))
    for head, expected in zip(("colour", "grey"), images, strict=True):
        export(trained, tmp_path / head, head)
        network = load_weights(tmp_path / head).network
        found_alpha, (found,) = composite(network(given), (head,))
        # the same sums, of some 9 x 12 products, by other kernels: some 1e-7
        torch.testing.assert_close(found, expected, rtol=0, atol=1e-5)
        torch.testing.assert_close(found_alpha, alpha, rtol=0, atol=1e-5)
    assert (images[0] - images[1]).abs().max() > 1e-3


def test_a_head_that_is_not_there(trained, weights_file, tmp_path):
    with pytest.raises(BadInput, match=r"has no head 'silver'; give one of colour, grey") as error:
        export(trained, tmp_path / "w", "silver")
    assert one_line(error).startswith(f"{trained}: ")
    with pytest.raises(BadInput, match="expected a checkpoint"):
        export(weights_file, tmp_path / "w", "grey")
    assert not list(tmp_path.iterdir())
