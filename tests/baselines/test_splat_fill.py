from __future__ import annotations

import numpy as np
import pytest

from baselines.splat_fill import SplatFill, outline, pull_push, visible
from data_prep.rendering.camera import project
from data_prep.scene import NEUTRAL_GREY, PointCloud, View
from tests.baselines.clouds import lattice_sphere

FRONT = View(0, 0)
GREY = NEUTRAL_GREY[0] / 255


def draw(points: object, view: View = FRONT) -> np.ndarray:
    """One channel of the picture of a cloud."""
    method = SplatFill()
    (image,) = method.draw(method.prepare(PointCloud(np.asarray(points, np.float32))), [view])
    return image[..., 0]


def plate() -> np.ndarray:
    """A lattice of 40 x 40 points on a square plate of side 1 that faces the camera."""
    rows, columns = np.meshgrid(*[(np.arange(40) + 0.5) / 40 - 0.5] * 2)
    return np.stack([columns, rows, 0 * rows], axis=-1).reshape(-1, 3)


@pytest.mark.parametrize("turn", [0.0, 60.0])
def test_a_flat_plate_has_the_grey_of_its_angle(turn: float) -> None:
    """The plate covers 58 x 58 pixels, turned by 60 degrees 29 x 58."""
    image = draw(plate(), View(turn, 0))
    expected = GREY * np.cos(np.radians(turn)) ** (1 / 2.2)
    np.testing.assert_allclose(image[40:88, 54:74], expected, atol=1e-6)
    assert (image[:, :32] == 1).all()
    assert (image[:, 96:] == 1).all()
    assert (1 - image).sum() / (1 - expected) == pytest.approx(
        58**2 * np.cos(np.radians(turn)), rel=0.06
    )


def test_a_sphere_is_shaded_as_the_light_along_the_view_does() -> None:
    image = draw(lattice_sphere())
    row, column = np.mgrid[:128, :128] + 0.5
    # The sphere's outline is at 41.3 px; parallel rays are near enough within half of it.
    reach = np.hypot(row - 64, column - 64) / 41.3
    inner = reach < 0.5
    expected = GREY * (1 - reach[inner] ** 2) ** (1 / 4.4)
    assert np.abs(image[inner] - expected).max() < 0.03
    assert (image[reach > 1.1] == 1).all()
    assert (image[reach < 0.9] < 1).all()


@pytest.mark.parametrize("count", [1, 50])
def test_a_lone_point_is_about_a_pixel(count: int) -> None:
    image = draw(np.full((count, 3), 0.01))
    (pixel,), _ = project(np.full((1, 3), 0.01), FRONT)
    column, row = pixel.astype(int)
    assert image[row, column] < 1
    image[row - 1 : row + 2, column - 1 : column + 2] = 1
    assert (image == 1).all()


def test_a_cloud_out_of_sight_is_white() -> None:
    for away in ((0, 0, -9), (9, 0, 0)):
        assert (draw(plate() + np.array(away)) == 1).all()


def test_noisy_points_are_smoothed() -> None:
    noisy = lattice_sphere() + np.random.default_rng(0).normal(scale=0.08, size=(2048, 3))
    state = SplatFill().prepare(PointCloud(noisy.astype(np.float32)))
    assert state.notes[1].startswith("smoothed: ")
    radii = np.linalg.norm(state.points, axis=1)
    assert radii.std() < 0.08 / 2
    assert len(SplatFill().prepare(PointCloud(lattice_sphere().astype(np.float32))).notes) == 1


def test_the_outline_closes_gaps_that_the_disc_cannot_enter() -> None:
    occupied = np.zeros((64, 64), bool)
    occupied[20:40, 10:20] = occupied[20:40, 25:35] = True  # 5 px apart
    closed, open_ = (outline(occupied, radius, margin=0.0) for radius in (6.0, 2.0))
    assert (closed[24:36, 10:35] == 1).all()
    assert (open_[20:40, 22] == 0).all()
    assert (open_[22:38, 12:18] == 1).all()
    for coverage in (closed, open_):
        assert (coverage[:18] == 0).all()
        assert (coverage[:, :8] == 0).all()


def test_the_margin_widens_the_outline_by_its_length() -> None:
    occupied = np.zeros((64, 64), bool)
    occupied[20:40, 20:40] = True
    areas = [outline(occupied, 6.0, margin).sum() for margin in (1.0, 2.0, 2.5)]
    assert np.diff(areas) == pytest.approx([80, 42], rel=0.1)


def test_points_are_hidden_by_nearer_ones_that_surround_them() -> None:
    depth = np.full((64, 64), np.inf)
    depth[10:50:4, 10:50:4] = 3.0
    depth[12:48:4, 12:48:4] = 5.0  # between the nearer ones
    depth[28, 58] = 5.0  # beside them
    depth[29, 29] = 3.1  # hardly behind
    shown = visible(depth, reach=4.0, tolerance=0.2)
    np.testing.assert_array_equal(shown, (depth < 4) | ((depth == 5) & (np.arange(64) == 58)))


def test_pull_push_keeps_full_pixels_and_fills_the_others() -> None:
    rng = np.random.default_rng(4)
    values, full = rng.random((32, 32)), rng.random((32, 32)) < 0.3
    filled = pull_push(values, full.astype(float))
    np.testing.assert_array_equal(filled[full], values[full])
    assert values[full].min() <= filled.min()
    assert filled.max() <= values[full].max()
    weights = np.where(full, rng.random((32, 32)), 0.0)
    np.testing.assert_allclose(pull_push(np.full((32, 32), 0.6), weights), 0.6, atol=1e-12)
    lone = np.zeros((32, 32), np.float64)
    lone[3, 7] = 0.01
    np.testing.assert_allclose(pull_push(np.where(lone > 0, 0.25, 0.0), lone), 0.25, atol=1e-12)
