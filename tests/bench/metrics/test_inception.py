"""The network behind FID: conformance vectors, its resizing, and the images that it refuses."""

from __future__ import annotations

import hashlib
import json
import re

import numpy as np
import pytest
import torch
import torch.nn.functional as F

from bench.metrics.inception import FidInception, inception_features

from .reference import REFERENCE

# Error budget, relative to the largest value. float32 through some fifty layers: the reference's
# own float32 and float64 differ by 8e-7, another order of summation by as much; ten times that.
FLOAT32 = 1e-5
# float64 features are stored as float32: 2^-24 = 6e-8 of each value, 1.2e-7 where a bit is lost
# elsewhere; logits are sums of 2,048 of them but stored as well.
FLOAT64 = 3e-7


def synthetic(key, shape):
    """The weight rule of the reference's README: a stream of its own for every key."""
    rng = np.random.default_rng(int.from_bytes(hashlib.sha256(key.encode()).digest()[:8], "big"))
    if key.endswith("num_batches_tracked"):
        return torch.tensor(0)
    if key.endswith("running_var"):
        values = 0.5 + rng.random(shape)
    elif key.endswith("bn.weight"):
        values = 0.8 + 0.4 * rng.random(shape)
    elif key.endswith(("running_mean", "bn.bias")):
        values = 0.1 * rng.standard_normal(shape)
    elif key == "fc.bias":
        values = np.zeros(shape)
    else:
        values = rng.standard_normal(shape) * np.sqrt(2 / np.prod(shape[1:]))
    return torch.tensor(values.astype(np.float32))


@pytest.fixture(scope="module")
def model():
    model = FidInception()
    shapes = {key: tuple(value.shape) for key, value in model.state_dict().items()}
    model.load_state_dict({key: synthetic(key, shape) for key, shape in shapes.items()})
    return model


@pytest.fixture(scope="module")
def reference():
    with np.load(REFERENCE / "inception_reference.npz") as arrays:
        return dict(arrays)


def off(actual, expected):
    """Largest difference, relative to the largest expected value."""
    return np.abs(np.asarray(actual, np.float64) - expected).max() / np.abs(expected).max()


def test_has_the_published_keys():
    published = json.loads((REFERENCE / "inception_keys.json").read_text())
    assert {key: list(v.shape) for key, v in FidInception().state_dict().items()} == published


def test_features_conform_to_reference(model, reference):
    features = inception_features(model, reference["images"])
    assert features.dtype == np.float32
    assert off(features, reference["features_2048_f32"]) < FLOAT32
    assert off(features, reference["features_2048_f64"]) < FLOAT32


def test_every_stage_conforms_in_float64(model, reference):
    seen = {}

    def keep(name, pool):
        def hook(_module, _inputs, output):
            seen[name] = pool(output).mean(dim=(2, 3)).numpy()

        return hook

    double = FidInception().double()
    double.load_state_dict(model.state_dict())
    reduced = lambda x: F.max_pool2d(x, 3, stride=2)  # noqa: E731
    double.Conv2d_2b_3x3.register_forward_hook(keep("f64", reduced))
    double.Conv2d_4a_3x3.register_forward_hook(keep("f192", reduced))
    double.Mixed_6e.register_forward_hook(keep("f768", lambda x: x))
    features = double(torch.tensor(reference["images"][:1]).permute(0, 3, 1, 2)).numpy()
    assert features.dtype == np.float64
    seen["features_2048_f64"] = features
    seen["logits_unbiased_f64"] = features @ double.fc.weight.numpy().T
    for name, actual in seen.items():
        assert off(actual, reference[name][:1]) < FLOAT64, name


@pytest.mark.parametrize("size", [2, 128, 640])
def test_resize_agrees_with_interpolation_on_a_grid(model, size):
    """Return the value by TensorFlow 1: read at multiples of the ratio, the last pixel held."""
    image = np.random.default_rng(0).integers(0, 256, (size, size), dtype=np.uint8)
    position = np.arange(299) * (size / 299)
    by_row = np.stack([np.interp(position, np.arange(size), row) for row in image])
    expected = np.stack([np.interp(position, np.arange(size), column) for column in by_row.T]).T
    seen = []
    handle = model.Conv2d_1a_3x3.register_forward_pre_hook(lambda _, given: seen.append(given[0]))
    inception_features(model, np.repeat(image[None, :, :, None], 3, axis=3))
    handle.remove()
    actual = 128 + 128 * seen[0][0, 0].numpy()
    # positions are float32 as in TensorFlow: off by up to 640 * 2^-24 = 4e-5 pixels, in two axes,
    # of up to 255 levels a pixel
    np.testing.assert_allclose(actual, expected, rtol=0, atol=0.03)


def test_is_frozen_and_looks_at_each_image_alone(model):
    image = np.random.default_rng(0).integers(0, 256, (1, 75, 90, 3), dtype=np.uint8)
    image.flags.writeable = False
    before = inception_features(model, image)
    assert np.all(before >= 0)  # means of ReLUs
    model.train()
    assert not any(module.training for module in model.modules())
    assert not any(parameter.requires_grad for parameter in model.parameters())
    both = np.concatenate([255 - image, image])
    alone = inception_features(model, both, batch=1)
    assert alone.shape == (2, 2048)
    np.testing.assert_array_equal(alone[1:], before)
    # other kernels, other order of summation
    assert off(inception_features(model, both), alone) < FLOAT32
    assert inception_features(model, image[:0]).shape == (0, 2048)


@pytest.mark.parametrize(
    ("shape", "dtype", "planes"),
    [
        ((1, 64, 64, 3), np.float32, (0, 3, 1, 2)),
        ((1, 3, 64, 64), np.uint8, (0, 2, 3, 1)),
        ((64, 64, 3), np.uint8, (0, 1, 2)),
    ],
)
def test_names_the_images_it_refuses(model, shape, dtype, planes):
    images = np.zeros(shape, dtype)
    given = torch.from_numpy(images).permute(planes)
    for ask, stack in (
        (lambda: inception_features(model, images), images),
        (lambda: model(given), given),
    ):
        with pytest.raises(ValueError, match=re.escape(f"{stack.dtype} {list(stack.shape)}")):
            ask()
