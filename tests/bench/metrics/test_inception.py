from __future__ import annotations

import hashlib
import json
import os
import re
import subprocess
import sys
import urllib.error
import urllib.request
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
import torch
import torch.nn.functional as F

import bench.metrics.inception
from bench.metrics import inception_weights
from bench.metrics.inception import FidInception, inception_features, load_inception
from bench.metrics.inception_weights import WeightsUnavailable, find_weights
from data_prep.failures import BadInput

REFERENCE = Path(
    os.environ.get("PC2PIX_REFERENCE", Path(__file__).parents[4] / "shared" / "reference")
)
needs_reference = pytest.mark.skipif(
    not (REFERENCE / "inception_reference.npz").is_file(),
    reason=f"no conformance vectors in {REFERENCE}; set PC2PIX_REFERENCE",
)

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


def off(found, expected):
    """Largest difference, relative to the largest expected value."""
    return np.abs(np.asarray(found, np.float64) - expected).max() / np.abs(expected).max()


# --- conformance ----------------------------------------------------------------------------------


@needs_reference
def test_has_the_published_keys():
    published = json.loads((REFERENCE / "inception_keys.json").read_text())
    assert {key: list(v.shape) for key, v in FidInception().state_dict().items()} == published


@needs_reference
def test_features_conform_to_reference(model, reference):
    features = inception_features(model, reference["images"])
    assert features.dtype == np.float32
    assert off(features, reference["features_2048_f32"]) < FLOAT32
    assert off(features, reference["features_2048_f64"]) < FLOAT32


@needs_reference
def test_every_stage_conforms_in_float64(model, reference):
    seen = {}

    def keep(name, pool):
        def hook(_module, _inputs, output):
            seen[name] = pool(output).mean(dim=(2, 3)).numpy()

        return hook

    double = FidInception().double()
    double.load_state_dict(model.state_dict())
    reduced = lambda x: F.max_pool2d(x, 3, stride=2)  # noqa: E731
    double.get_submodule("Conv2d_2b_3x3").register_forward_hook(keep("f64", reduced))
    double.get_submodule("Conv2d_4a_3x3").register_forward_hook(keep("f192", reduced))
    double.get_submodule("Mixed_6e").register_forward_hook(keep("f768", lambda x: x))
    features = double(torch.tensor(reference["images"]).permute(0, 3, 1, 2)).numpy()
    assert features.dtype == np.float64
    for name in ("f64", "f192", "f768"):
        assert off(seen[name], reference[name]) < FLOAT64, name
    assert off(features, reference["features_2048_f64"]) < FLOAT64
    logits = features @ double.fc.weight.numpy().T
    assert off(logits, reference["logits_unbiased_f64"]) < FLOAT64


def half_pixel_centres(images, size):
    return F.interpolate(images, (size, size), mode="bilinear", align_corners=False)


def counts_the_padding(x, kind):
    return F.avg_pool2d(x, 3, stride=1, padding=1) if kind == "average" else POOL(x, kind)


def averages_in_the_last_block(x, kind):
    return POOL(x, "average" if kind == "max" else kind)


POOL = bench.metrics.inception._pool


@needs_reference
@pytest.mark.parametrize(
    ("name", "wrong"),
    [
        ("_resize", half_pixel_centres),
        ("_pool", counts_the_padding),
        ("_pool", averages_in_the_last_block),
    ],
)
def test_known_mistakes_would_be_caught(model, reference, monkeypatch, name, wrong):
    # The ways in which the torchvision network differs from that of FID.
    monkeypatch.setattr(bench.metrics.inception, name, wrong)
    features = inception_features(model, reference["images"][:1])
    assert off(features, reference["features_2048_f32"][:1]) > 100 * FLOAT32


# --- closed form and independent implementation ---------------------------------------------------


def test_resize_reads_at_multiples_of_the_ratio():
    rows = torch.tensor([[0.0, 10.0], [20.0, 30.0]])[None, None]
    # positions 0, 0.5, 1, 1.5, the last one beyond the edge: held
    expected = [[0, 5, 10, 10], [10, 15, 20, 20], [20, 25, 30, 30], [20, 25, 30, 30]]
    assert bench.metrics.inception._resize(rows, 4)[0, 0].tolist() == expected


@pytest.mark.parametrize("size", [32, 128, 299, 640])
def test_resize_agrees_with_interpolation_on_a_grid(size):
    image = np.random.default_rng(0).random((size, size))
    position = np.arange(299) * (size / 299)
    by_row = np.stack([np.interp(position, np.arange(size), row) for row in image])
    expected = np.stack([np.interp(position, np.arange(size), column) for column in by_row.T]).T
    found = bench.metrics.inception._resize(torch.tensor(image)[None, None], 299)[0, 0].numpy()
    # positions are float32 as in TensorFlow: off by up to 640 * 2^-24 = 4e-5 pixels, in two axes
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-4)


# --- invariants -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def images():
    return np.random.default_rng(0).integers(0, 256, (3, 128, 128, 3), dtype=np.uint8)


def test_image_does_not_depend_on_its_batch(model, images):
    together = inception_features(model, images)
    alone = inception_features(model, images, batch=1)
    assert together.shape == (3, 2048)
    assert off(alone, together) < FLOAT32  # other kernels, other order of summation
    assert np.all(together >= 0)  # means of ReLUs


def test_is_frozen(model, images):
    before = inception_features(model, images[:1])
    model.train()
    assert not model.training
    assert not any(module.training for module in model.modules())
    assert not any(parameter.requires_grad for parameter in model.parameters())
    np.testing.assert_array_equal(inception_features(model, images[:1]), before)


def test_takes_read_only_images_of_any_size_and_none_at_all(model):
    image = np.zeros((1, 75, 90, 3), np.uint8)
    image.flags.writeable = False
    assert inception_features(model, image).shape == (1, 2048)
    assert inception_features(model, image[:0]).shape == (0, 2048)


@pytest.mark.parametrize(
    ("images", "named"),
    [
        (np.zeros((1, 64, 64, 3), np.float32), "float32 [1, 64, 64, 3]"),
        (np.zeros((1, 3, 64, 64), np.uint8), "uint8 [1, 3, 64, 64]"),
        (np.zeros((64, 64, 3), np.uint8), "uint8 [64, 64, 3]"),
    ],
)
def test_names_the_images_it_refuses(model, images, named):
    with pytest.raises(ValueError, match=re.escape(named)):
        inception_features(model, images)


@pytest.mark.parametrize(
    ("shape", "dtype"), [((1, 3, 64, 64), torch.float32), ((1, 64, 64, 3), torch.uint8)]
)
def test_network_names_what_it_refuses(model, shape, dtype):
    with pytest.raises(ValueError, match=re.escape(f"{dtype} {list(shape)}")):
        model(torch.zeros(shape, dtype=dtype))


# --- the weight file ------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def weights(model):
    """A file with the published keys; its checksum stands in for the published one."""
    buffer = BytesIO()
    torch.save(model.state_dict(), buffer)
    return buffer.getvalue()


@pytest.fixture
def published(weights, monkeypatch, tmp_path):
    digest = hashlib.sha256(weights).hexdigest()
    monkeypatch.setattr(inception_weights, "WEIGHTS_SHA256", digest)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "pc2pix-bench" / inception_weights.WEIGHTS_NAME


@contextmanager
def response(data):
    yield BytesIO(data)


def serve(monkeypatch, data):
    requests = []

    def urlopen(url, timeout):
        requests.append((url, timeout))
        return response(data)

    monkeypatch.setattr(urllib.request, "urlopen", urlopen)
    return requests


def no_network(monkeypatch):
    def urlopen(url, timeout):
        raise urllib.error.URLError("no route to host")

    monkeypatch.setattr(urllib.request, "urlopen", urlopen)


def test_loads_a_given_file(model, weights, published, monkeypatch, tmp_path, images):
    no_network(monkeypatch)
    path = tmp_path / "weights.pth"
    path.write_bytes(weights)
    features = inception_features(load_inception(path), images[:1])
    assert off(features, inception_features(model, images[:1])) < FLOAT32  # another memory layout
    assert not published.exists()


def test_refuses_another_file_before_unpickling_it(monkeypatch, tmp_path):
    path = tmp_path / "other.pth"
    path.write_bytes(b"anything")
    monkeypatch.setattr(torch, "load", lambda *_, **__: pytest.fail("was loaded"))
    with pytest.raises(BadInput) as caught:
        load_inception(path)
    message = str(caught.value)
    for part in (
        str(path),
        hashlib.sha256(b"anything").hexdigest(),
        "6726825d0af5f729cebd5821db510b11b1cfad8faad88a03f1befd49fb9129b2",
        inception_weights.WEIGHTS_URL,
    ):
        assert part in message
    assert "\n" not in message
    with pytest.raises(BadInput, match="missing"):
        load_inception(tmp_path / "missing.pth")


def test_fetches_once_then_reads_the_cache(weights, published, monkeypatch):
    requests = serve(monkeypatch, weights)
    assert find_weights("download") == published
    assert requests == [(inception_weights.WEIGHTS_URL, inception_weights.DOWNLOAD_TIMEOUT_S)]
    assert [path.name for path in published.parent.iterdir()] == [published.name]
    no_network(monkeypatch)
    assert find_weights("download") == published
    assert find_weights(None) == published
    assert isinstance(load_inception(published), FidInception)


def test_never_asks_the_network_unasked(published, monkeypatch):
    monkeypatch.setattr(urllib.request, "urlopen", lambda *_, **__: pytest.fail("asked"))
    with pytest.raises(WeightsUnavailable, match="--inception-weights download"):
        find_weights(None)


def test_a_given_file_is_verified_when_it_is_looked_for(weights, published, tmp_path):
    path = tmp_path / "weights.pth"
    path.write_bytes(weights)
    assert find_weights(str(path)) == path
    path.write_bytes(weights[:-1])
    with pytest.raises(BadInput, match="sha256"):
        find_weights(str(path))


def test_fetches_a_damaged_cached_file_anew(weights, published, monkeypatch):
    published.parent.mkdir(parents=True)
    published.write_bytes(weights[:-1])
    serve(monkeypatch, weights)
    assert find_weights("download").read_bytes() == weights


def test_says_how_to_get_the_weights_without_a_network(published, monkeypatch):
    no_network(monkeypatch)
    with pytest.raises(WeightsUnavailable, match="no route to host") as caught:
        find_weights("download")
    assert inception_weights.WEIGHTS_URL in str(caught.value)


def test_keeps_nothing_of_a_download_that_is_not_the_file(published, monkeypatch):
    serve(monkeypatch, b"<html>Please log in</html>")
    with pytest.raises(WeightsUnavailable, match="26 bytes"):
        find_weights("download")
    assert not published.exists()


def test_says_so_where_the_cache_cannot_be_written(weights, published, monkeypatch):
    published.parent.parent.write_bytes(b"")  # a file where the folder should be
    serve(monkeypatch, weights)
    with pytest.raises(WeightsUnavailable, match="cannot keep"):
        find_weights("download")


def test_weights_are_found_without_torch():
    code = "import sys, bench.metrics.inception_weights as _; sys.exit('torch' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True, cwd=Path(__file__).parents[3])
