"""Clean surfaces that lie close to each other, and noise."""

from __future__ import annotations

import numpy as np
import pytest

from baselines.reconstruction.denoised import (
    NOISY,
    PATCHES,
    cleaned,
    noise_in_patches,
    noise_scale,
)
from baselines.reconstruction.layers import in_layers
from baselines.reconstruction.stages import Nearest, spacing
from data_prep.scene import PointCloud
from tests.baselines.clouds import RADIUS, lattice_sphere


def boards(count: int, apart: float) -> np.ndarray:
    """Points of six boards above each other, so far apart."""
    rng = np.random.default_rng(1)
    levels = apart * rng.integers(6, size=count)
    return np.column_stack([rng.uniform(-0.7, 0.7, (count, 2)), levels])


def shells(count: int, apart: float) -> np.ndarray:
    """Points of two spheres, the smaller of which lies so far below the larger."""
    points = lattice_sphere(count)
    points[::2] *= (RADIUS - apart) / RADIUS
    return points


@pytest.mark.parametrize("count", [512, 2048])
def test_layers_a_spacing_apart_are_no_noise(count: int) -> None:
    near = Nearest(boards(count, spacing(Nearest(boards(count, 0.0)))))
    distance, index = near.within(PATCHES[0])
    thickness, _ = noise_in_patches(near.points, distance[:, -1], index)
    assert thickness > NOISY * spacing(near)  # which would be smoothed
    assert in_layers(near)
    assert noise_scale(near) == 0
    assert cleaned(PointCloud(near.points), 1.0).noise == 0


def test_curved_layers() -> None:
    assert in_layers(Nearest(shells(2048, spacing(Nearest(shells(2048, 0.0))))))


@pytest.mark.parametrize("share", [0.6, 1.0, 3.0])
@pytest.mark.parametrize("shape", [boards, shells])
def test_noise_is_no_layers(shape, share: float) -> None:
    """The noise is so many spacings: the least that is smoothed, and five times as much."""
    flat = shape(2048, 0.0)
    noise = share * spacing(Nearest(flat))
    noisy = flat + np.random.default_rng(2).normal(scale=noise, size=flat.shape)
    assert not in_layers(Nearest(noisy))


def test_what_has_no_layers() -> None:
    rng = np.random.default_rng(3)
    for points in (rng.normal(size=(23, 3)), rng.normal(size=(500, 3)), np.ones((60, 3))):
        assert not in_layers(Nearest(points))
    line = np.linspace(-1, 1, 500)[:, None] * [1.0, 0, 0]  # no three points give a plane
    assert not in_layers(Nearest(line))
    points = boards(600, 0.05)
    assert in_layers(Nearest(points)) == in_layers(Nearest(rng.permutation(points)))
