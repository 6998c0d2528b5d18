from __future__ import annotations

import numpy as np
import pytest
import torch

from data_prep.clouds.sampling import sample_surface
from data_prep.datasets.registry import ProceduralObject
from data_prep.failures import StageFailure
from data_prep.randomness import generator
from data_prep.scene import PointCloud, View
from pc2pix.number_formats import FORMATS, GREY_LEVELS, deviation, infer
from pc2pix.renderer import Pc2pixRenderer
from pc2pix.weights import load_weights
from tests.learning.trainings import make_clouds

VIEWS = [View(30.0, 20.0), View(-130.0, -15.0)]


@pytest.fixture
def tiny(weights_file):
    return load_weights(weights_file)


@pytest.fixture(scope="module")
def points():
    mesh = ProceduralObject("chair", "test", 0).load()
    return sample_surface(mesh, generator("test", "formats")).points


@pytest.mark.parametrize("name", ["chair", "chair-acgan"])
def test_float32_is_what_the_renderer_draws_and_every_layer_is_watched(name, points):
    weights = load_weights(name)
    actual = infer(weights, points, VIEWS, "float32")
    layers = [
        f"{prefix}.{path}"
        for prefix, network in (("encoder", weights.encoder), ("generator", weights.generator))
        for path, module in network.named_modules()
        if getattr(module, "bias", None) is not None
    ]
    assert len(layers) > 20
    assert sorted(layer.name for layer in actual.layers) == sorted(layers)
    renderer = Pc2pixRenderer(weights)
    state = renderer.prepare(PointCloud(points))
    # the renderer encodes a large cloud's parts one by one: float32 sums in another order, values
    # up to 3, some ten roundings of 2^-23 of that; rotated codes are sums of numbers up to 600
    # standard deviations of the smallest large
    atol = 3e-6 if name == "chair" else 3e-5
    np.testing.assert_allclose(actual.code, state[0].numpy(), rtol=0, atol=atol)
    # of the same code: the generator of chair-acgan makes 2e-5 of a rounding of the code
    drawn = renderer.draw(torch.tensor(actual.code, dtype=torch.float32), VIEWS)
    # the renderer's kernels lie in another order in memory: float32 sums differ by some 1e-6
    np.testing.assert_allclose(actual.images, drawn, rtol=0, atol=1e-5)


def test_weights_stay_as_they_are(tiny):
    before = {key: value.clone() for key, value in tiny.generator.state_dict().items()}
    for fmt in FORMATS:
        infer(tiny, make_clouds(1)[0], VIEWS, fmt)
    after = tiny.generator.state_dict()
    assert all(after[key].dtype == value.dtype for key, value in before.items())
    assert all(torch.equal(after[key], value) for key, value in before.items())


def test_wider_formats_are_nearer(points):
    weights = load_weights("chair")
    exact = infer(weights, points, VIEWS, "float64").images
    errors = [
        GREY_LEVELS * deviation(infer(weights, points, VIEWS, fmt).images, exact).mean
        for fmt in ("float32", "float16", "bfloat16")
    ]
    # unit roundoffs 2^-24, 2^-11, 2^-8: ratios 8192 and 8, each within the factor of 3 by which the
    # amplification varies; the sums of float32 are rounded, too, those of the others hardly
    assert 8192 / 9 < errors[1] / errors[0] < 8192 * 3
    assert 8 / 3 < errors[2] / errors[1] < 8 * 3


def test_an_overflow_is_found_in_its_layer(tiny):
    points = make_clouds(1)[0]
    with torch.no_grad():
        tiny.generator.blocks[2].conv1.bias[0] = -7e4  # float16 ends at 65,504
    half = infer(tiny, points, VIEWS, "float16")
    assert half.overflowed == "generator.blocks.2.conv1"
    layers = {layer.name: layer for layer in half.layers}
    assert layers["generator.blocks.2.conv1"].non_finite == len(VIEWS) * 16 * 16
    assert layers["generator.blocks.1.conv2"].non_finite == 0
    assert np.isfinite(half.code).all()
    for fmt in ("float64", "float32", "bfloat16"):
        wide = infer(tiny, points, VIEWS, fmt)
        assert wide.overflowed is None
        largest = {layer.name: layer.largest for layer in wide.layers}
        # bfloat16 keeps 8 digits: half a unit of 70,000 is 256
        assert largest["generator.blocks.2.conv1"] == pytest.approx(7e4, abs=300)


def test_an_overflow_between_layers_is_found_before_the_next(tiny):
    with torch.no_grad():  # each fits, their sum does not
        tiny.generator.blocks[1].conv2.bias[0] = 4e4
        tiny.generator.blocks[1].shortcut.bias[0] = 4e4
    half = infer(tiny, make_clouds(1)[0], VIEWS, "float16")
    assert half.overflowed == "input of generator.blocks.2.bn1"
    names = [layer.name for layer in half.layers]
    assert sum(name.startswith("input") for name in names) == 1
    assert names.index(half.overflowed) + 1 == names.index("generator.blocks.2.bn1")


@pytest.mark.parametrize(
    ("scale", "stage", "refusal"),
    [  # float32 ends at 3.4e38; largest value over the scale: code 9, block 4's shortcut 99
        (1.0, None, None),
        (1e30, None, "the code lies "),
        (4e36, "generate", "the code lies "),
        (1e38, "encode", "the code is not finite"),
    ],
)
def test_the_renderer_refuses_what_overflows_before_it_is_drawn(points, scale, stage, refusal):
    weights = load_weights("chair-acgan")
    large = points * np.float32(scale)
    actual = infer(weights, large, VIEWS, "float32")
    assert actual.refused == stage
    assert (actual.overflowed is None) == (stage is None)
    renderer = Pc2pixRenderer(weights)
    if refusal is None:
        assert np.isfinite(renderer.draw(renderer.prepare(PointCloud(large)), VIEWS)).all()
        return
    with pytest.raises(StageFailure, match=refusal) as failure:
        renderer.prepare(PointCloud(large))
    assert failure.value.stage == "encode"


def test_deviation():
    actual = deviation(np.array([1.0, 2.0, -3.0]), np.array([1.0, 0.0, -4.0]))
    assert actual == (2.0, 1.0)
    assert deviation(np.array([1.0, np.inf]), np.zeros(2)) is None
    assert deviation(np.zeros(2), np.array([np.nan, 0.0])) is None
