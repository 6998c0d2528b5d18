from __future__ import annotations

import numpy as np
import pytest
import torch

from data_prep.clouds.conditions import GaussianNoise
from data_prep.clouds.sampling import sample_surface
from data_prep.datasets.registry import ProceduralObject
from data_prep.failures import StageFailure
from data_prep.scene import PointCloud, View
from pc2pix import load
from pc2pix.renderer import parts, pick_points
from tests.learning.trainings import make_clouds

VIEWS = [View(0, 0), View(90, 20), View(-180, -40)]


@pytest.fixture(scope="module")
def renderer(weights_file):
    return load(weights_file)


@pytest.fixture(scope="module")
def cloud():
    return PointCloud(make_clouds(1)[0])


def test_networks_get_whitened_codes_and_normalised_angles(renderer, cloud):
    weights = renderer.weights
    with torch.no_grad():
        code = weights.encoder(torch.from_numpy(cloud.points.copy())[None])
        code = (code - weights.code_mean) / weights.code_std
        expected = weights.generator(
            noise=torch.zeros(1, 128),
            code=code,
            elevation01=torch.tensor([[0.75]]),  # 20 / 80 + 0.5
            azimuth01=torch.tensor([[0.25]]),  # -90 / 360 + 0.5
        )
    (actual,) = renderer.draw(renderer.prepare(cloud), [View(-90, 20)])
    expected = expected[0].permute(1, 2, 0).numpy() / 2 + 0.5
    np.testing.assert_allclose(actual, expected, rtol=0, atol=1e-6)


def test_uniform_noise_comes_from_the_rng(weights_file, cloud):
    renderer = load(weights_file, z="uniform")
    state = renderer.prepare(cloud)
    first, same, other = (
        renderer.draw(state, VIEWS, np.random.default_rng(seed)) for seed in (0, 0, 1)
    )
    assert np.array_equal(first, same)
    assert not np.array_equal(first, other)
    with pytest.raises(ValueError, match="rng"):
        renderer.draw(state, VIEWS)


@pytest.mark.parametrize("count", [1, 512, 1500, 2048, 2049, 4096])
def test_any_number_of_points_becomes_2048(count):
    """Row i of fewer is row floor(i N / 2048), repeated evenly; of more 2,048 different ones are
    taken. Both are in the cloud's order."""
    points = np.arange(count * 3, dtype=np.float32).reshape(count, 3)
    found = pick_points(points)
    assert found.shape == (2048, 3)
    if count <= 2048:
        assert np.array_equal(found, points[[i * count // 2048 for i in range(2048)]])
    else:
        rows = found[:, 0] / 3
        assert (np.diff(rows) >= 1).all()
        assert np.array_equal(found, points[rows.astype(int)])


def test_parts_of_a_large_cloud_depend_on_no_order_and_use_nearly_all_points():
    rng = np.random.default_rng(0)
    small = rng.normal(size=(1024, 3)).astype(np.float32)
    assert np.array_equal(parts(small), small[None])
    assert parts(np.concatenate([small, small[:1]])).shape == (8, 1024, 3)
    points = rng.normal(size=(2048, 3)).astype(np.float32)
    result = parts(points)
    assert result.shape == (8, 1024, 3)
    assert np.array_equal(result, parts(rng.permutation(points)))
    known = {tuple(row) for row in points}
    for part in result:
        chosen = {tuple(row) for row in part}
        assert len(chosen) == 1024
        assert chosen <= known
    # a point is in none of eight halves with probability 2^-8: 8 of 2,048, deviation 2.8
    assert len({tuple(row) for part in result for row in part}) > 2048 - 8 - 4 * 2.8


@pytest.mark.parametrize("name", ["chair", "chair-acgan"])
def test_codes_far_off_are_refused_and_those_of_noisy_clouds_are_not(name):
    renderer, rng = load(name), np.random.default_rng(0)
    cloud = sample_surface(ProceduralObject("chair", "validation", 0).load(), rng)
    noisy = GaussianNoise(0.5).apply(cloud, rng)
    code = renderer.prepare(noisy)
    assert code.abs().max() < 50
    with pytest.raises(StageFailure, match="encode: the code is not finite"):
        renderer.prepare(PointCloud(np.full((4, 3), 3e38)))
    outlier = cloud.points.copy()
    outlier[7] = 0, 0, 1e3
    far_off = pytest.raises(StageFailure, match=r"encode: the code lies .* to the unit sphere")
    for points in (outlier, cloud.points + np.float32(1e6)):
        with far_off:
            renderer.prepare(PointCloud(points))
    for side in (1, -1):
        renderer.code_mean = renderer.code_mean - side * 100 * renderer.code_std
        with far_off:
            renderer.prepare(noisy)
        renderer.code_mean = renderer.code_mean + side * 100 * renderer.code_std


def test_other_precisions_are_refused(weights_file):
    with pytest.raises(ValueError, match="float32 or bfloat16, got 'float16'"):
        load(weights_file, precision="float16")  # pyright: ignore[reportArgumentType]
