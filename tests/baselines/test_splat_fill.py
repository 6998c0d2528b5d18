from __future__ import annotations

import numpy as np
import pytest

from baselines.splat_fill import SplatFill
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


def plate(count: int = 40, side: float = 1.0) -> np.ndarray:
    """A lattice of points on a square plate that faces the camera: of 58 px a unit."""
    rows, columns = np.meshgrid(*[((np.arange(count) + 0.5) / count - 0.5) * side] * 2)
    return np.stack([columns, rows, 0 * rows], axis=-1).reshape(-1, 3)


@pytest.mark.parametrize("turn", [0.0, 60.0])
def test_a_flat_plate_has_the_grey_of_its_angle(turn: float) -> None:
    """The plate covers 58 x 58 pixels, turned by 60 degrees 29 x 58."""
    image = draw(plate(), View(turn, 0))
    expected = GREY * np.cos(np.radians(turn)) ** (1 / 2.2)
    np.testing.assert_allclose(image[40:88, 54:74], expected, atol=1e-6)
    assert (image[:, :32] == 1).all()
    assert (image[:, 96:] == 1).all()
    covered = (1 - image).sum() / (1 - expected)
    assert covered == pytest.approx(58**2 * np.cos(np.radians(turn)), rel=0.06)


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
    assert np.linalg.norm(state.points, axis=1).std() < 0.08 / 2
    assert SplatFill().prepare(PointCloud(lattice_sphere().astype(np.float32))).notes == ()


@pytest.mark.parametrize(("gap", "closed"), [(1.5, True), (4.0, False)])
def test_gaps_are_closed_that_the_disc_cannot_enter(gap: float, closed: bool) -> None:
    """A spacing is half the distance of the 16th nearest, 1.1 lattice steps here: the disc is 3.4
    steps wide, and so are gaps that it cannot enter."""
    points = plate()
    points[:, 0] += np.sign(points[:, 0]) * gap / 80
    middle = draw(points)[45:83, 63:65]
    np.testing.assert_allclose(middle, GREY if closed else 1.0, atol=1e-6)
