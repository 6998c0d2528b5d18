from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
import torch
from torch.nn import functional

from baselines.splat_net.network import (
    CODE_POINTS,
    PRIOR,
    SIZES,
    CloudCode,
    NetworkConfig,
    SplatNet,
    camera_numbers,
    code_rows,
    composite,
)
from baselines.splat_net.projection import Inputs
from data_prep.failures import BadInput
from data_prep.scene import View

from .conftest import SMALL, lived_in

SEEN = SMALL.inputs.channels


def logit(probability):
    return math.log(probability / (1 - probability))


def test_codes_heed_neither_order_nor_company():
    torch.manual_seed(0)
    code = CloudCode(6).requires_grad_(False)
    clouds = torch.randn(3, 200, 3)
    found = code(clouds)
    assert found.shape == (3, 6)
    assert found.abs().max() < 1
    assert (found[0] - found[1]).abs().max() > 1e-3
    # a mean of 200 float32 numbers in another order, three layers on: some 1e-7
    torch.testing.assert_close(code(clouds[:, torch.randperm(200)]), found, rtol=0, atol=1e-6)
    torch.testing.assert_close(code(clouds[1:2]), found[1:2], rtol=0, atol=1e-6)


def test_codes_know_the_number_of_points_by_its_logarithm():
    torch.manual_seed(0)
    code = CloudCode(6).requires_grad_(False)
    cloud = torch.randn(1, 128, 3)
    many = cloud.repeat(1, 8, 1)
    # all points eight times: the largest and the mean stay, the logarithm grows by ln 8
    assert (code(many) - code(cloud)).abs().max() > 1e-3
    first = code.cloud[0]
    first.bias -= math.log(8) * first.weight[:, -1]
    moved = code(many)
    first.bias += math.log(8) * first.weight[:, -1]
    torch.testing.assert_close(moved, code(cloud), rtol=0, atol=1e-6)
    # ln 1097 is 7.0003: there the number says nothing
    few = torch.randn(1, 1097, 3)
    before = code(few)
    first.weight[:, -1] = 0
    torch.testing.assert_close(code(few), before, rtol=0, atol=1e-3)


def test_codes_are_bounded():
    code = CloudCode(6).requires_grad_(False)
    assert code(torch.full((1, 5, 3), 1e20)).abs().max() <= 1


def test_composites_by_hand():
    output = torch.zeros(2, 5, 1, 1)
    output[0, :, 0, 0] = torch.tensor([logit(p) for p in (0.25, 0.2, 0.4, 0.6, 0.8)])
    output[1, 0] = -200.0  # nothing is covered
    alpha, (colour, grey) = composite(output, ("colour", "grey"))
    assert alpha.shape == (2, 1, 1, 1)
    assert colour.shape == (2, 3, 1, 1)
    assert grey.shape == (2, 1, 1, 1)
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


def test_composites_are_float32_whatever_they_are_made_of():
    output = torch.randn(1, 2, 4, 4)
    _, (exact,) = composite(output, ("grey",))
    _, (coarse,) = composite(output.bfloat16(), ("grey",))
    assert coarse.dtype == torch.float32
    expected = composite(output.bfloat16().float(), ("grey",))[1][0]
    assert torch.equal(coarse, expected)
    assert not torch.equal(coarse, exact)


def convolution(cin, cout, side, bias):
    return cin * cout * side * side + (cout if bias else 0)


def block(cin, cout):
    return convolution(cin, cout, 3, bias=False) + 2 * cout  # and scale and shift


def linear(*sizes):
    return sum(cin * cout + cout for cin, cout in pairwise(sizes))


@pytest.mark.parametrize("config", [*SIZES.values(), SMALL])
def test_number_of_parameters(config):
    pairs = list(pairwise(config.widths))
    narrow, wide = config.widths[0], config.widths[-1]
    down = sum(block(a, b) + block(b, b) for a, b in pairs)
    lift = sum(convolution(b, a, 1, bias=True) for a, b in pairs)
    # one block at the two fine levels, two at the two coarse ones
    up = sum(times * block(a, a) for times, a in zip((1, 1, 2, 2), config.widths[:4], strict=True))
    code = linear(3, 64, 128, 256) + linear(2 * 256 + 1, 256, config.code)
    prior = linear(config.code + 4, 128, PRIOR * 8 * 8)
    expected = block(config.inputs.channels, narrow) + down + block(wide + PRIOR, wide) + lift + up
    expected += convolution(narrow, 1 + 3 + 1, 3, bias=True) + code + prior
    assert sum(p.numel() for p in SplatNet(config).parameters()) == expected


def test_weights_are_small():
    """Two bytes a weight; the bundled ones are to take less than 4 MB."""
    size = {name: 2 * sum(p.numel() for p in SplatNet(c).parameters()) for name, c in SIZES.items()}
    assert size["tiny"] < size["default"] < size["large"]
    assert size["default"] < 4e6


@pytest.mark.parametrize("size", [16, 64, 128, 256])
def test_pictures_of_many_sizes(size):
    network = lived_in(SMALL)
    output = network(
        torch.randn(2, SEEN, size, size),
        torch.randn(2, 4),
        camera_numbers([View(0, 0), View(90, 9)]),
    )
    assert output.shape == (2, 5, size, size)
    assert output.isfinite().all()
    assert output.std() > 0.01


def test_code_and_camera_reach_the_picture():
    network = lived_in(SMALL)
    channels = torch.randn(1, SEEN, 32, 32).expand(2, -1, -1, -1)
    code, angles = torch.randn(2, 4), camera_numbers([View(0, 0), View(120, 30)])
    for codes, views in ((code, angles[[0, 0]]), (code[[0, 0]], angles)):
        one, other = network(channels, codes, views)
        assert (one - other).abs().max() > 0.1
    one, other = network(channels, code[[0, 0]], angles[[0, 0]])
    torch.testing.assert_close(one, other, rtol=0, atol=1e-5)  # the same sums


def test_what_is_expected_stands_beside_what_is_seen():
    """At the narrowest level: channels seen, then those that code and camera make up."""
    network = lived_in(SMALL)
    channels, code = torch.randn(1, SEEN, 32, 32), torch.randn(1, 4)
    angles = camera_numbers([View(30, 10)])
    found = {}
    network.down[-1].register_forward_hook(lambda m, i, y: found.update(seen=y.clone()))
    network.middle.register_forward_pre_hook(lambda m, x: found.update(given=x[0].clone()))
    network(channels, code, angles)
    assert torch.equal(found["given"][:, :12], found["seen"])
    assert torch.equal(found["given"][:, 12:], network.prior(code, angles, 2))


def test_the_prior_is_a_map_of_8x8_resized():
    prior = lived_in(SMALL).prior
    code, angles = torch.randn(2, 4), camera_numbers([View(30, 10), View(-90, -10)])
    exact = prior(code, angles, 8)
    expected = prior.layers(torch.cat([code, angles], dim=1)).view(2, PRIOR, 8, 8)
    assert torch.equal(exact, expected)
    # half of the size is the mean of four, for a pixel's centre lies between theirs
    half = functional.avg_pool2d(exact, 2)
    torch.testing.assert_close(prior(code, angles, 4), half, rtol=0, atol=1e-6)
    assert prior(code, angles, 16).shape == (2, PRIOR, 16, 16)
    assert prior(code, angles, 1).shape == (2, PRIOR, 1, 1)


def test_without_a_code_there_is_no_prior():
    network = SplatNet(NetworkConfig(widths=SMALL.widths, code=0, heads=("grey",)))
    assert not hasattr(network, "code")
    assert not hasattr(network, "prior")
    assert network.eval()(torch.randn(1, SEEN, 16, 16), None, torch.zeros(1, 4)).shape[1] == 2


@pytest.mark.parametrize("count", [1, CODE_POINTS - 1, CODE_POINTS])
def test_small_clouds_are_encoded_whole(count):
    assert code_rows(count).tolist() == list(range(count))


def test_of_large_clouds_some_points_are_encoded():
    rows = code_rows(5 * CODE_POINTS)
    assert len(rows) == len(set(rows.tolist())) == CODE_POINTS
    assert 0 <= rows.min() <= rows.max() < 5 * CODE_POINTS
    # Uniform over 5 n rows, whose deviation is 5 n / sqrt(12): four deviations of a mean of n.
    middle = (5 * CODE_POINTS - 1) / 2
    assert abs(rows.double().mean() - middle) < 4 * 5 * CODE_POINTS / (12 * CODE_POINTS) ** 0.5
    assert torch.equal(rows, code_rows(5 * CODE_POINTS))


def test_outputs_follow_from_the_heads():
    assert NetworkConfig().outputs == 5
    assert NetworkConfig(heads=("colour",)).outputs == 4
    assert NetworkConfig(heads=("grey",)).outputs == 2
    inputs = Inputs(windows=(3,), normals=False, density=False, flattened=False, far=False)
    assert SplatNet(NetworkConfig(inputs, SMALL.widths)).first.conv.weight.shape == (4, 1, 3, 3)


def test_camera_numbers():
    found = camera_numbers([View(0, 0), View(90, 30), View(-270, 30), View(540, -90)])
    half, root = 0.5, 0.75**0.5
    expected = [[0, 0, 1, 1], [1, half, 0, root], [1, half, 0, root], [0, -1, -1, 0]]
    torch.testing.assert_close(found, torch.tensor(expected), rtol=0, atol=1e-6)
    assert camera_numbers([]).shape == (0, 4)
    numpy_s = camera_numbers([View(np.float64(90), np.float64(30))])
    assert numpy_s.dtype == torch.float32
    assert torch.equal(numpy_s, camera_numbers([View(90, 30)]))


@pytest.mark.parametrize("widths", [(), (4, 4, 4, 4), (4, 4, 4, 4, 4, 4), (4, 4, 0, 4, 4)])
def test_widths_that_are_none(widths):
    with pytest.raises(BadInput, match="expected five numbers, each at least 1"):
        NetworkConfig(widths=widths)
