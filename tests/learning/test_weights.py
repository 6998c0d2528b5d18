from __future__ import annotations

from pathlib import Path

import pytest
import torch
from torch import nn

from data_prep.failures import BadInput
from learning import weights

PATH = Path("w.safetensors")
REMEDY = "write it again"


def build():
    torch.manual_seed(0)
    return nn.Sequential(nn.Linear(2, 3), nn.BatchNorm1d(3))


def stored():
    return {k: v.clone() for k, v in weights.without_counters(build().state_dict()).items()}


EXPECTED = {
    "0.weight": (3, 2),
    "0.bias": (3,),
    "1.weight": (3,),
    "1.bias": (3,),
    "1.running_mean": (3,),
    "1.running_var": (3,),
}


def test_shapes_of_an_outline():
    with torch.device("meta"):
        network = build()
    assert weights.expected_shapes(network) == EXPECTED
    assert weights.expected_shapes(network, "a.") == {f"a.{k}": v for k, v in EXPECTED.items()}


def test_what_fits_is_taken():
    weights.check_tensors(PATH, stored(), EXPECTED, REMEDY)
    halved = {key: value.half() for key, value in stored().items()}
    weights.check_tensors(PATH, halved, EXPECTED, REMEDY)


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (lambda t: t.pop("0.bias"), "tensor 0.bias is missing"),
        (lambda t: t.update(more=torch.zeros(1)), "tensor more is unknown"),
        (
            lambda t: t.update({"0.bias": torch.zeros(1, 3)}),
            "0.bias has shape [1, 3], expected [3]",
        ),
        (lambda t: t.update({"0.bias": torch.zeros(3).bfloat16()}), "0.bias is of torch.bfloat16"),
        (lambda t: t.update({"0.bias": torch.zeros(3) > 0}), "0.bias is of torch.bool"),
        (lambda t: t["1.running_var"][1].fill_(torch.nan), "1.running_var is not finite"),
        (lambda t: t["1.running_var"][1].fill_(-torch.inf), "1.running_var is not finite"),
    ],
)
def test_what_does_not_is_refused(change, problem):
    tensors = stored()
    change(tensors)
    with pytest.raises(BadInput) as error:
        weights.check_tensors(PATH, tensors, EXPECTED, REMEDY)
    assert str(error.value).startswith(f"{PATH}: {problem}")
    assert str(error.value).endswith(f"; {REMEDY}")


def test_a_filled_network_has_what_was_stored():
    network, tensors = build(), {key: 2 * value.half() for key, value in stored().items()}
    weights.fill_network(network, tensors)
    assert not network.training
    for key, value in network.state_dict().items():
        if key in tensors:
            assert value.dtype == torch.float32
            assert torch.equal(value, tensors[key].float())
    assert not any(p.requires_grad for p in network.parameters())
