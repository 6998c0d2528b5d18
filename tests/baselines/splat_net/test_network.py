from __future__ import annotations

import dataclasses
import math

import pytest
import torch

from baselines.splat_net.network import (
    COLOUR_HEADS,
    NETWORKS,
    NEUTRAL,
    NetworkConfig,
    composite,
    shading_of,
)
from baselines.splat_net.points2pix import build
from data_prep.failures import BadInput
from tests.learning.trainings import SMALL

from .conftest import lived_in


def logit(probability):
    return math.log(probability / (1 - probability))


def test_composites_by_hand():
    output = torch.zeros(2, 5, 1, 1)
    output[0, :, 0, 0] = torch.tensor([logit(p) for p in (0.25, 0.2, 0.4, 0.6, 0.8)])
    output[1, 0] = -200.0  # nothing is covered
    alpha, (colour, grey) = composite(output, ("colour", "grey"))
    assert (alpha.shape, colour.shape, grey.shape) == ((2, 1, 1, 1), (2, 3, 1, 1), (2, 1, 1, 1))
    assert alpha[0].item() == pytest.approx(0.25, abs=1e-6)
    # a quarter of the cover, three quarters of white
    assert colour[0].flatten().tolist() == pytest.approx([0.8, 0.85, 0.9], abs=1e-6)
    assert grey[0].item() == pytest.approx(0.95, abs=1e-6)
    assert alpha[1] == 0
    assert (colour[1] == 1).all()
    assert (grey[1] == 1).all()
    output[:, 0] = 200.0  # all is covered: only the cover is left
    _, (grey, colour) = composite(output, ("grey", "colour"))
    assert grey[0].item() == pytest.approx(0.2, abs=1e-6)
    assert colour[0].flatten().tolist() == pytest.approx([0.4, 0.6, 0.8], abs=1e-6)


def test_number_of_parameters():
    actual = {n: sum(p.numel() for p in build(c).parameters()) for n, c in NETWORKS.items()}
    assert actual == {"default": 1_354_133, "points2pix": 1_824_501}


@pytest.mark.parametrize(
    ("size", "heads", "planes"),
    [
        (16, ("colour",), 4),
        (64, ("grey",), 2),
        (256, COLOUR_HEADS["pixel"], 5),
        (16, COLOUR_HEADS["image"], 5),
    ],
)
def test_outputs_of_many_sizes_and_heads(size, heads, planes):
    network = lived_in(NetworkConfig(widths=SMALL.widths, heads=heads))
    output = network(torch.randn(2, SMALL.inputs.channels, size, size))
    assert output.shape == (2, planes, size, size)
    assert output.isfinite().all()
    assert output.std() > 0.01


def test_an_albedo_is_one_colour_times_the_shading_of_grey() -> None:
    output = torch.tensor([0.3, -0.4, 1.0, 0.0, -2.0]).reshape(1, 5, 1, 1)
    alpha, cover, red, green, blue = torch.sigmoid(output).flatten().tolist()
    _, (grey, colour) = composite(output, ("grey", "albedo"))
    assert grey.item() == pytest.approx(1 + alpha * (cover - 1))
    shading = cover / NEUTRAL
    expected = [1 + alpha * (part * shading - 1) for part in (red, green, blue)]
    assert colour.flatten().tolist() == pytest.approx(expected)
    assert shading_of(torch.tensor([NEUTRAL, 0.99])).tolist() == [1.0, 1.0]  # never more than all


def test_a_guess_of_the_colour_teaches_the_colour_alone() -> None:
    network = lived_in(NetworkConfig(widths=SMALL.widths, heads=COLOUR_HEADS["image"]))
    network.train().requires_grad_(True)
    output = network(torch.rand(2, network.config.inputs.channels, 16, 16))
    composite(output, network.config.heads)[1][1].sum().backward()
    taught = {name for name, p in network.named_parameters() if p.grad is not None and p.grad.any()}
    assert taught == {"albedo.weight", "albedo.bias"}


@pytest.mark.parametrize(
    ("config", "wrong", "says"),
    [
        *(
            ("default", {"heads": heads}, "splat-net: an albedo goes with the head grey")
            for heads in (("albedo",), ("albedo", "grey"), ("colour", "albedo"))
        ),
        ("points2pix", {"heads": ("grey", "albedo")}, "of points2pix: an albedo goes with"),
        *(
            ("default", {"widths": widths}, "expected five numbers, each at least 1")
            for widths in ((4,) * 4, (4,) * 6, (4, 4, 0, 4, 4))
        ),
    ],
)
def test_networks_that_are_none(config, wrong, says):
    with pytest.raises(BadInput, match=says):
        dataclasses.replace(NETWORKS[config], **wrong)
