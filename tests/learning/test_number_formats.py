from __future__ import annotations

import numpy as np
import pytest
import torch
from torch.nn import functional

from bench.catalogue.methods import find_method
from data_prep.datasets.registry import ProceduralObject
from data_prep.randomness import generator
from data_prep.scene import View
from data_prep.stages import NETWORK, at_stages
from learning.number_formats import in_format, plain_layouts

X = torch.linspace(-3, 3, 48, dtype=torch.float32).reshape(2, 24)
W = torch.linspace(-1, 1, 24 * 5, dtype=torch.float32).reshape(5, 24)


def test_float64_is_the_arithmetic_of_float64():
    with in_format("float64"):
        y = functional.linear(X, W).tanh()
    assert y.dtype == torch.float64
    torch.testing.assert_close(y, functional.linear(X.double(), W.double()).tanh(), rtol=0, atol=0)


def test_float64_keeps_views_and_what_is_written_into_them():
    with in_format("float64"):
        out = torch.zeros(2, 3)
        for column, value in zip(out.unbind(1), (1.0, 2.0, 3.0), strict=True):
            torch.add(column, value, out=column)
        out[:, 1] *= 10
    assert out.tolist() == [[1, 20, 3]] * 2


@pytest.mark.parametrize(("name", "unit"), [("bfloat16", 2.0**-8), ("float16", 2.0**-11)])
def test_results_are_rounded_to_the_format(name, unit):
    with in_format(name):
        total = X + 1e-3
        view = total[:, :3]
        view += 1.0
    assert total.dtype == torch.float32
    kind = getattr(torch, name)
    assert torch.equal(total, total.to(kind).float())
    exact = X.double() + 1e-3
    exact[:, :3] += 1
    # Two roundings of values below 4: each errs by at most half of a unit in the last place.
    assert float((total - exact).abs().max()) <= 2 * 4 * unit
    assert not torch.equal(total, exact.float())


def test_values_beyond_the_range_of_float16_are_infinite():
    with in_format("float16"):
        assert torch.isinf(torch.full((1,), 300.0) * 300).all()
    with in_format("bfloat16"):
        assert torch.isfinite(torch.full((1,), 300.0) * 300).all()


@pytest.mark.parametrize(
    ("method", "wider"), [("pc2pix", 1.0), ("splat-net@tiny-grey", 1.0), ("occupancy-net", 8.0)]
)
@pytest.mark.slow
def test_the_coarser_the_format_the_farther_the_image(method, wider):
    cloud = ProceduralObject("chair", "test", 0).cloud(generator(0, "formats"))
    views, rng = (View(30.0, 20.0),), generator(0)

    def drawn(name=None):
        with plain_layouts():
            renderer = find_method(method).load("cpu")
            if name is None:
                return 255 * renderer.draw(renderer.prepare(cloud, rng), views, rng)
            with at_stages((NETWORK,), lambda: in_format(name)):
                return 255 * renderer.draw(renderer.prepare(cloud, rng), views, rng)

    usual = drawn()
    apart = {
        name: float(np.abs(drawn(name) - usual).mean())
        for name in ("float64", "float16", "bfloat16")
    }
    # Mean grey levels; float32 has 24 bits, float16 11 and bfloat16 8. Measured: at most 1e-4, 0.5
    # and 2.0, the last two where an occupancy net's surface moves.
    assert apart["float64"] < 0.01
    assert apart["float64"] < apart["float16"] < apart["bfloat16"] < wider
