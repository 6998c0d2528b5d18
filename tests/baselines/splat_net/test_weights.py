from __future__ import annotations

import numpy as np
import pytest
import torch

from baselines import fused_net, splat_net
from baselines.splat_net.network import SplatNet, composite
from baselines.splat_net.weights import export, load_weights
from data_prep.failures import BadInput
from data_prep.rendering.images import to_uint8
from data_prep.scene import PointCloud, View
from learning import checkpoint
from tests.baselines.clouds import lattice_sphere
from tests.learning.trainings import SMALL


def test_a_file_of_one_head_draws_what_the_trained_network_draws_with_it(trained, tmp_path):
    state, _, _ = checkpoint.load(trained, "splat-net")
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


# Grey levels at the middle, near its edge, and beside it.
@pytest.mark.parametrize(
    ("package", "name", "levels"),
    [
        (splat_net, "all", (175, 142, 255)),
        (fused_net, "all", (180, 148, 255)),
    ],
)
def test_the_grey_of_a_bundled_file_is_the_same_network_without_its_albedo(package, name, levels):
    renderer, coloured = package.load(f"{name}-grey"), package.load(name).weights
    weights = renderer.weights
    assert (weights.network.config.heads, weights.sha256) == (("grey",), coloured.sha256)
    shared, albedo = weights.network.state_dict(), coloured.network.state_dict()
    assert {*albedo} - {*shared} == {"albedo.weight", "albedo.bias"}
    assert all(torch.equal(value, albedo[key]) for key, value in shared.items())
    cloud = PointCloud(lattice_sphere(2048))
    image = renderer.draw(renderer.prepare(cloud), [View(20, 10)])
    assert np.array_equal(image, np.broadcast_to(image[..., :1], image.shape))
    # to a level, as other processors round
    drawn = to_uint8(image)[0, 64, [64, 98, 120], 0].astype(int)
    assert drawn.tolist() == pytest.approx(levels, abs=1)
