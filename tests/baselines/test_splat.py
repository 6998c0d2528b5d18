from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from scipy.spatial import cKDTree

from baselines.splat import Discs, Splat
from data_prep.rendering.camera import project
from data_prep.scene import PointCloud, View

FRONT = View(0, 0)
VIEWS = [FRONT, View(40, 25), View(-160, -40), View(7, 90)]


def draw(discs: Discs, view: View = FRONT, size: int = 128) -> np.ndarray:
    """One channel of an image."""
    (image,) = Splat().draw(discs, [view], size=size)
    return image[..., 0]


def brute_force(discs: Discs, view: View, size: int) -> np.ndarray:
    """Pixel by pixel: the nearest disc that covers the centre decides.

    Its grey is 0.75 at the nearest point of the unit sphere (depth 3), 0.35 at the farthest (5).
    """
    zoom = size / 128
    pixels, depth = project(discs.centres, view)
    rows, columns = np.mgrid[:size, :size] + 0.5
    image = np.ones((size, size))
    nearest = np.full((size, size), np.inf)
    for (column, row), d in zip(zoom * pixels, depth, strict=True):
        if d <= 0.2:
            continue
        reach = min(max(zoom * discs.radius * 232 / d, math.sqrt(0.5)), zoom * 16)
        hit = ((columns - column) ** 2 + (rows - row) ** 2 <= reach**2) & (d < nearest)
        nearest[hit] = d
        image[hit] = np.interp(d, [3, 5], [0.75, 0.35])
    return image


def uniform(extent: float) -> np.ndarray:
    return np.random.default_rng(5).uniform(-extent, extent, (300, 3)).astype(np.float32)


@pytest.mark.parametrize(
    "discs",
    [
        *(Discs(uniform(0.8), radius) for radius in (0.0, 0.04, 0.3)),  # the last: above 16 pixels
        Discs(uniform(1.6), 0.1),  # some are cut by the border
        Discs(uniform(5.0), 0.1),  # some are behind the camera
        *(Splat().prepare(PointCloud(scale * uniform(1.0))) for scale in (1e-6, 1e6)),
    ],
    ids=["pixels", "discs", "large", "border", "behind", "tiny", "huge"],
)
def test_agrees_with_brute_force(discs: Discs) -> None:
    for view, size in itertools.product(VIEWS, (128, 40, 600)):
        if size == 600 and view != VIEWS[1]:  # of which one view takes as long as all others
            continue
        image, expected = draw(discs, view, size), brute_force(discs, view, size)
        np.testing.assert_allclose(image, expected, rtol=0, atol=2.0**-24)


def test_what_is_behind_the_camera_or_outside_is_not_drawn() -> None:
    outside = [[0, 0, -5], [0, 0, -4], [0, 0, -3.81], [3, 0, 0], [0, -3, 0], [0, 0, -1e6]]
    outside += [[1e3, 1e3, -1e3], [1e30, 1e30, -1e30], [1e30, 1e30, 1e30], [1e30, 0, 0]]
    assert (draw(Discs(np.float32(outside), 0.1)) == 1).all()
    assert (draw(Discs(np.float32([[0, 0, -3.79]]), 0.1)) < 1).any()


@pytest.mark.parametrize("repeated", [0, 1, 2, 700])
def test_radius_is_the_median_distance_to_the_nearest_other_point(repeated: int) -> None:
    """Repeated points among many are counted, not searched: it takes no more time."""
    rows = np.random.default_rng(0).standard_normal((700, 3)).astype(np.float32)
    if repeated:
        rows = rows[::repeated]
        rows = np.concatenate([rows, rows[: len(rows) // 2 + 1], rows[:1].repeat(2500, axis=0)])
    few, counts = np.unique(rows, axis=0, return_counts=True)
    distances = np.linalg.norm(few[:, None].astype(np.float64) - few, axis=2)
    np.fill_diagonal(distances, np.inf)
    nearest = np.repeat(np.where(counts > 1, 0.0, distances.min(axis=1)), counts)
    for method, spread in ((Splat(), 1.0), (Splat(spread=2.5), 2.5)):
        actual = method.prepare(PointCloud(rows)).radius
        assert actual == pytest.approx(spread * np.median(nearest), rel=1e-12)


@pytest.mark.parametrize(("times", "share"), [(1, 1.0), (2, 0.0)])
def test_the_radius_of_many_points_is_nearly_that_of_all_in_any_order(times, share) -> None:
    """The standard error of a median of 8,192 such distances is 0.8 %."""
    rng = np.random.default_rng(3)
    points = rng.standard_normal((20_000, 3)).astype(np.float32)
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    of_all = np.median(cKDTree(points).query(points, k=2)[0][:, 1])
    rows = np.repeat(points, times, axis=0)
    radius = Splat().prepare(PointCloud(rows)).radius
    assert radius == pytest.approx(share * of_all, rel=0.024)
    assert Splat().prepare(PointCloud(rng.permutation(rows))).radius == radius


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
    state = Splat().prepare(PointCloud(points, colors=colors))
    (image,) = np.rint(255 * Splat().draw(state, [FRONT])).astype(int)
    grey = draw(Splat().prepare(PointCloud(points)))
    assert np.array_equal((image < 255).any(axis=2), grey < 1)
    drawn = {tuple(colour) for colour in image.reshape(-1, 3).tolist()} - {(255, 255, 255)}
    assert drawn == {(255, 0, 10), (0, 200, 0), (90, 80, 70)}
    lone = Splat().prepare(PointCloud(points[:1] * 0, colors=colors[:1]))
    (pixel,) = Splat().draw(lone, [FRONT])[:, 63, 63]
    assert np.rint(255 * pixel).tolist() == [255, 0, 10]
