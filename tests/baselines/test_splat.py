from __future__ import annotations

import math

import numpy as np
import pytest

from baselines.splat import Discs, Splat
from data_prep.rendering.camera import project
from data_prep.scene import PointCloud, View

FRONT = View(0, 0)
VIEWS = [FRONT, View(40, 25), View(-160, -40), View(7, 90)]
ROW, COLUMN = np.mgrid[:128, :128] + 0.5


def draw(discs: Discs, view: View = FRONT) -> np.ndarray:
    """One channel of an image, and assert that it is grey."""
    (image,) = Splat().draw(discs, [view])
    assert image.shape == (128, 128, 3)
    assert (image == image[..., :1]).all()
    return image[..., 0]


def discs(points: object, radius: float = 0.0) -> Discs:
    return Discs(np.asarray(points, np.float32).reshape(-1, 3), radius)


def grey_at(depth: float) -> float:
    """0.75 at the nearest point of the unit sphere (depth 3), 0.35 at the farthest (5)."""
    return float(np.interp(depth, [3, 5], [0.75, 0.35]))


def brute_force(points: np.ndarray, radius: float, view: View) -> np.ndarray:
    """Pixel by pixel: the nearest disc that covers the centre decides."""
    pixels, depth = project(points, view)
    image = np.ones((128, 128))
    nearest = np.full((128, 128), np.inf)
    for (column, row), d in zip(pixels, depth, strict=True):
        if d <= 0.2:
            continue
        reach = min(max(radius * 232 / d, math.sqrt(0.5)), 16)
        hit = ((COLUMN - column) ** 2 + (ROW - row) ** 2 <= reach**2) & (d < nearest)
        nearest[hit] = d
        image[hit] = grey_at(d)
    return image


@pytest.mark.parametrize("view", VIEWS, ids=str)
@pytest.mark.parametrize("radius", [0.0, 0.04, 0.3])  # the last is more than 16 pixels
def test_agrees_with_brute_force(view: View, radius: float) -> None:
    points = np.random.default_rng(5).uniform(-0.8, 0.8, (300, 3)).astype(np.float32)
    image = draw(discs(points, radius), view)
    np.testing.assert_allclose(image, brute_force(points, radius, view), rtol=0, atol=2.0**-24)


def test_what_is_behind_the_camera_or_outside_is_not_drawn() -> None:
    outside = [[0, 0, -5], [0, 0, -4], [0, 0, -3.81], [3, 0, 0], [0, -3, 0], [0, 0, -1e6]]
    outside += [[1e3, 1e3, -1e3], [1e30, 1e30, -1e30], [1e30, 1e30, 1e30], [1e30, 0, 0]]
    assert (draw(discs(outside, 0.1)) == 1).all()
    both = draw(discs([*outside, [0.1, 0.2, 0]], 0.1))
    np.testing.assert_array_equal(both, draw(discs([0.1, 0.2, 0], 0.1)))
    assert (draw(discs([0, 0, -3.79], 0.1)) < 1).any()


def test_discs_are_cut_at_the_border() -> None:
    edge = 64 / 232 * 4
    image = draw(discs([[edge, 0, 0], [-edge, 0, 0], [0, edge, 0], [0, -edge, 0]], 0.1))
    reach = 0.1 * 232 / 4
    near = np.min(
        [np.hypot(ROW - r, COLUMN - c) for r, c in ((64, 0), (64, 128), (0, 64), (128, 64))], axis=0
    )
    np.testing.assert_array_equal(image < 1, near <= reach)


@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_extreme_scales(scale: float) -> None:
    points = scale * np.random.default_rng(7).normal(size=(200, 3)).astype(np.float32)
    state = Splat().prepare(PointCloud(points))
    for view in VIEWS:
        image = draw(state, view)
        np.testing.assert_allclose(
            image, brute_force(state.centres, state.radius, view), rtol=0, atol=2.0**-24
        )
    if scale < 1:
        assert np.argwhere(draw(state) < 1).min() == 63


def test_radius_is_the_median_distance_to_the_nearest_other_point() -> None:
    points = np.random.default_rng(8).normal(size=(301, 3)).astype(np.float32)
    distances = np.linalg.norm(points[:, None].astype(np.float64) - points[None], axis=2)
    np.fill_diagonal(distances, np.inf)
    expected = np.median(distances.min(axis=1))
    for method, spread in ((Splat(), 1.0), (Splat(spread=2.5), 2.5)):
        actual = method.prepare(PointCloud(points)).radius
        assert actual == pytest.approx(spread * expected, rel=1e-12)


@pytest.mark.parametrize("count", [1, 50])
def test_a_lone_point_lights_the_four_pixels_around_it(count: int) -> None:
    state = Splat().prepare(PointCloud(np.zeros((count, 3))))
    assert state.radius == 0.0
    lit = np.argwhere(draw(state) < 1).tolist()
    assert lit == [[63, 63], [63, 64], [64, 63], [64, 64]]


def test_colours_of_points_are_those_of_their_discs_whatever_the_depth() -> None:
    """A nearer disc covers a farther one; only pixels of one point have its colour."""
    points = np.array([[0.5, 0, 0.5], [-0.5, 0, -0.5], [0, 0, 0.2], [0, 0, -0.2]], np.float32)
    colors = np.array([[255, 0, 10], [0, 200, 0], [1, 2, 3], [90, 80, 70]], np.uint8)
    method = Splat(colors=colors)
    state = method.prepare(PointCloud(points))
    (image,) = np.rint(255 * method.draw(state, [FRONT])).astype(int)
    plain = Splat()
    (grey,) = plain.draw(plain.prepare(PointCloud(points)), [FRONT])
    assert np.array_equal((image < 255).any(axis=2), (grey < 1).any(axis=2))
    drawn = {tuple(colour) for colour in image.reshape(-1, 3).tolist()} - {(255, 255, 255)}
    assert drawn == {(255, 0, 10), (0, 200, 0), (90, 80, 70)}
    (lone,) = Splat(colors=colors[:1]).draw(
        Splat(colors=colors[:1]).prepare(PointCloud(points[:1] * 0)), [FRONT]
    )
    assert np.rint(255 * lone[63, 63]).tolist() == [255, 0, 10]


@pytest.mark.parametrize("step", [1, 2, 700])
def test_many_equal_points_take_no_more_time(step):
    """Some rows are repeated; the radius is the median of all distances, one by one."""
    rows = np.random.default_rng(0).standard_normal((700, 3)).astype(np.float32)[::step]
    points = np.concatenate([rows, rows[: len(rows) // 2 + 1], rows[:1].repeat(2500, axis=0)])
    few = np.unique(points, axis=0)
    distances = np.linalg.norm(points[:, None].astype(float) - few, axis=-1)
    counts = (distances == 0) @ np.array([(points == row).all(axis=1).sum() for row in few])
    other = np.where(distances == 0, np.inf, distances).min(axis=1)
    expected = np.median(np.where(counts > 1, 0.0, other))
    assert Splat().prepare(PointCloud(points)).radius == pytest.approx(expected, rel=1e-12)
