"""The part that fused-net is shown of clouds with more points than it was trained for."""

import numpy as np
import pytest

from baselines.fused_net.many_points import FEW, shown_to_network
from baselines.reconstruction.alpha_wrap import AlphaWrap, is_smooth
from data_prep.failures import StageFailure
from data_prep.scene import PointCloud

RADIUS = 0.8


def sphere(count: int, noise: float = 0.0) -> PointCloud:
    rng = np.random.default_rng(5)
    points = rng.normal(size=(count, 3))
    points *= RADIUS / np.linalg.norm(points, axis=1, keepdims=True)
    return PointCloud((points + rng.normal(scale=noise, size=points.shape)).astype(np.float32))


def rows(points: np.ndarray) -> set[tuple[float, ...]]:
    return {tuple(point) for point in points.tolist()}


def off(points: np.ndarray) -> float:
    return float(np.std(np.linalg.norm(points, axis=1) - RADIUS))


def test_a_cloud_of_few_different_points_is_shown_as_it_is():
    few = sphere(FEW)
    assert shown_to_network(few).cloud is few
    twice = PointCloud(np.repeat(few.points, 2, axis=0))
    shown = shown_to_network(twice)
    assert (shown.cloud, shown.source, shown.noise, shown.notes) == (twice, None, 0, ())


def test_of_a_clean_cloud_a_subset_is_shown_and_all_points_make_the_mesh():
    cloud = sphere(10_000)
    shown = shown_to_network(cloud)
    assert len(shown.cloud) == 8192
    assert rows(shown.cloud.points) < rows(cloud.points)
    assert rows(shown.source) == rows(cloud.points)
    assert (shown.noise, shown.notes) == (0, ("input: 8192 of 10000 points used",))
    turned = shown_to_network(PointCloud(cloud.points[::-1]))
    np.testing.assert_array_equal(turned.cloud.points, shown.cloud.points)
    np.testing.assert_array_equal(turned.source, shown.source)


@pytest.mark.parametrize(
    ("noise", "count", "mesh_of_all"), [(0.015, 7946, True), (0.04, 2048, False)]
)
def test_of_a_noisy_cloud_points_are_shown_with_less_noise(noise, count, mesh_of_all):
    shown = shown_to_network(sphere(40_000, noise))
    assert len(shown.cloud) == pytest.approx(count, rel=0.03)
    assert off(shown.cloud.points) < 0.8 * noise
    assert (shown.source is not None) == mesh_of_all
    kind, used = shown.notes
    assert float(kind.removeprefix("noise: ")) == pytest.approx(noise, rel=0.3)
    assert used == f"input: {len(shown.cloud)} points used, smoothed by all 40000"


def test_the_noisiest_points_are_shown_as_they_are():
    cloud = sphere(20_000, 0.15)
    shown = shown_to_network(cloud)
    assert len(shown.cloud) == 2048
    assert rows(shown.cloud.points) < rows(cloud.points)
    assert shown.notes[1:] == ("input: 2048 of 20000 points used",)


def test_points_beyond_the_camera_are_left_out_and_others_refused():
    far = np.vstack([sphere(10_000).points, [[9, 0, 0]]]).astype(np.float32)
    assert "input: 1 of 10001 points left out, they lie beyond the camera" in (
        shown_to_network(PointCloud(far)).notes
    )
    far[0, 0] = np.nan
    with pytest.raises(StageFailure, match="1 of 10001 points are not finite"):
        shown_to_network(PointCloud(far))


def test_a_wrap_is_smooth_of_clean_points_and_rough_of_noisy_ones():
    assert is_smooth(AlphaWrap().prepare(sphere(8192)).mesh)
    assert not is_smooth(AlphaWrap().prepare(sphere(8192, 0.02)).mesh)
