from __future__ import annotations

import pytest
import torch

from baselines.splat_net.engine import FoldedSplatNet
from baselines.splat_net.network import NetworkConfig, SplatNet, composite
from baselines.splat_net.projection import Inputs

from .conftest import lived_in

BOTH = NetworkConfig(widths=(8, 12, 16, 20, 24))
GREY = NetworkConfig(widths=(8, 12, 16, 20, 24), heads=("grey",))
ALBEDO = NetworkConfig(widths=(8, 12, 16, 20, 24), heads=("grey", "albedo"))
# Sums of up to 9 x 24 float32 products in another order, through 20 layers: some 1e-6.
CLOSE = 1e-5


def inputs(config, count, size=128):
    random = torch.Generator().manual_seed(1)
    channels = torch.rand(count, config.inputs.channels, size, size, generator=random)
    return channels.to(memory_format=torch.channels_last)


def drawn(network, channels):
    """Return the images by the albedo, or else by the first head."""
    with torch.no_grad():
        _, images = composite(network(channels), network.config.heads)
    image = images["albedo" in network.config.heads]
    return image.expand(-1, 3, -1, -1).permute(0, 2, 3, 1)


@pytest.fixture(params=[BOTH, GREY, ALBEDO], ids=["both", "grey", "albedo"])
def network(request):
    return lived_in(request.param)


def test_float32_draws_what_the_network_draws_and_leaves_it_as_it_is(network):
    before = {key: value.clone() for key, value in network.state_dict().items()}
    given = inputs(network.config, 3)
    actual = FoldedSplatNet(network)(given)
    assert actual.shape == (3, 128, 128, 3)
    assert actual.dtype == torch.float32
    assert all(torch.equal(value, before[key]) for key, value in network.state_dict().items())
    expected = drawn(network, given)
    assert expected.std() > 0.01
    torch.testing.assert_close(actual, expected, rtol=0, atol=CLOSE)


# from one channel, whose layout in memory is ambiguous, to all; and layers one channel wide
@pytest.mark.parametrize("width", [1, 2])
@pytest.mark.parametrize("flags", [(False,) * 4, (True, False) * 2, (True,) * 4])
def test_some_or_all_of_the_channels(flags, width):
    config = NetworkConfig(Inputs((3,), *flags), (width,) * 5, ("grey",))
    network = lived_in(config)
    given = inputs(config, 2, 32)
    actual = FoldedSplatNet(network)(given)
    torch.testing.assert_close(actual, drawn(network, given), rtol=0, atol=CLOSE)


def test_bfloat16_is_bfloat16(network):
    channels = inputs(network.config, 3)
    folded = FoldedSplatNet(network, "bfloat16")
    apart = (folded(channels.to(folded.dtype)) - drawn(network, channels)).abs().mean()
    # Half a unit of 8 digits is 2e-3 of a value; some twenty roundings in a row, added as errors
    # do. A sigmoid hands on a quarter, of values around 2.
    assert 1e-4 < apart < 2e-3 * 20**0.5 / 2


@pytest.mark.parametrize("precision", ["float32", "bfloat16"])
def test_one_image_or_many(network, precision):
    folded = FoldedSplatNet(network, precision)
    channels = inputs(network.config, 5, 64).to(folded.dtype)
    together = folded(channels)
    assert (together[0] - together[1]).abs().max() > 0.01
    # sums in another order: float32 as above, bfloat16 by units of 1/256 here and there
    atol = CLOSE if precision == "float32" else 0.05
    for i in range(5):
        alone = folded(channels[i : i + 1])
        torch.testing.assert_close(alone, together[i : i + 1], rtol=0, atol=atol)


@pytest.mark.parametrize("where", ["first.norm.bias", "down.3.1.norm.running_mean", "last.bias"])
def test_what_is_not_finite_stays_so(where):
    network = lived_in(GREY)
    network.state_dict()[where][0] = torch.nan
    assert FoldedSplatNet(network)(inputs(GREY, 1, 32)).isnan().any()


def test_other_precisions_are_refused():
    with pytest.raises(ValueError, match="float32 or bfloat16, got 'float16'"):
        FoldedSplatNet(SplatNet(BOTH), "float16")  # pyright: ignore[reportArgumentType]
