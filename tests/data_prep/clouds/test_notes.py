"""Notes on clouds: points far from an object, and coordinates in steps that can be seen."""

from __future__ import annotations

import time
import warnings
from collections.abc import Iterator

import numpy as np
import pytest

from data_prep.clouds.coarse_steps import note_on_steps
from data_prep.clouds.far_points import far_points, note_on_far, radius
from data_prep.clouds.sampling import sample_surface
from data_prep.datasets.registry import open_dataset
from data_prep.randomness import generator
from data_prep.scene import Mesh

COUNTS = (64, 345, 2048)


def shapes(of_class: int) -> Iterator[Mesh]:
    dataset = open_dataset("procedural")
    for name in dataset.classes:
        for obj in dataset.objects(name, of_class, of_class):
            yield obj.load()


def clouds(mesh: Mesh) -> Iterator[np.ndarray]:
    rng = np.random.default_rng(0)
    for count in COUNTS:
        points = sample_surface(mesh, rng, count).points.astype(float)
        yield points
        yield points + rng.normal(0, 0.1, points.shape)
    yield mesh.vertices[np.unique(mesh.faces)].astype(float)


@pytest.fixture(scope="module")
def chair_points() -> np.ndarray:
    (chair,) = open_dataset("procedural").objects("chair", 1, 1)
    return sample_surface(chair.load(), generator(0), 2048).points.astype(float)


@pytest.fixture(scope="module")
def object_points(chair_points: np.ndarray) -> np.ndarray:
    return chair_points[:345]


def with_far(points: np.ndarray, far: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return all points in another order, and which are the far ones."""
    order = np.random.default_rng(1).permutation(len(points) + len(far))
    return np.vstack([points, far])[order], (np.arange(len(order)) >= len(points))[order]


def ball(count: int, size: float) -> np.ndarray:
    return np.random.default_rng(2).normal(0, size, (count, 3))


FAR = {
    "one": np.array([[40.0, 3, 2]]),
    "one at three times the radius": np.array([[0.0, 0, 3]]),
    "returns at one place, 30 %": np.full((148, 3), -9.0),
    "more returns than points": np.full((500, 3), 30.0),
    "-9999, 30 %": np.full((148, 3), -9999.0),
    "some together": np.array([5.0, 5, 5]) + ball(5, 0.01),
    "at several scales": np.array([[1e300, 0, 0], [-9999, 0, 0], [0, -1e30, 1], [0, 8, 0]]),
    "all around": np.array([[-28.0, -8, 2], [9, -17, 3], [16, 12, 7], [2, 9, -15], [5, 3, 4]]),
    "floaters, 3 %": ball(10, 10),
}


@pytest.mark.parametrize("name", FAR)
def test_points_far_from_an_object_are_found_at_any_place_and_scale(
    object_points: np.ndarray, name: str
) -> None:
    points, expected = with_far(object_points, FAR[name])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for factor, shift in ((1.0, 0.0), (1e-9, 0.0), (1e3, 3e5)):
            if np.abs(points).max() < 1e6 or not shift:
                np.testing.assert_array_equal(far_points(points * factor + shift), expected)


@pytest.mark.parametrize("share", [0.05, 0.3])
def test_missing_heights_of_a_terrain_are_far(share: float) -> None:
    x, z = np.meshgrid(np.arange(40.0), np.arange(40.0))
    points = np.stack([x, 4 * np.sin(x / 9) * np.cos(z / 7), z], axis=-1).reshape(-1, 3)
    expected = np.random.default_rng(0).random(len(points)) < share
    points[expected, 1] = -9999
    np.testing.assert_array_equal(far_points(points), expected)


@pytest.mark.parametrize("count", [9, 10, 12, 16, 24])
def test_few_points_have_gaps_everywhere(count: int) -> None:
    for points in np.random.default_rng(0).normal(0, 1, (50, count, 3)):
        assert not far_points(points).any()
    points[0] = 50
    assert np.flatnonzero(far_points(points)).tolist() == [0]


def test_the_rest_of_what_hangs_together_stays(object_points: np.ndarray) -> None:
    rng = np.random.default_rng(0)
    thin = np.column_stack([rng.normal(0, 0.01, (150, 2)), rng.uniform(0, 12, 150)])
    second = object_points + np.array([6.0, 0, 0])
    grid = np.stack(np.meshgrid(*[np.arange(4.0)] * 3), -1).reshape(-1, 3)
    for points in (
        np.vstack([object_points, thin]),
        np.vstack([object_points, second]),
        np.vstack([object_points, second[::6]]),
        np.vstack([object_points, np.zeros((100, 3))]),  # within
        grid,
        np.zeros((50, 3)),
        np.array([[0.0, 0, 0], [1, 0, 0], [900, 0, 0]]),  # too few to tell
        np.full((20, 3), np.nan),
        np.empty((0, 3)),
    ):
        assert not far_points(points).any()


def test_no_shape_of_ours_has_far_points() -> None:
    for mesh in shapes(1):
        assert not any(far_points(points).any() for points in clouds(mesh))


def test_the_note_has_the_share_of_the_image_and_a_million_points_take_no_time() -> None:
    points, far = with_far(ball(400, 1).clip(-1, 1), np.full((3, 3), 50.0))
    note = note_on_far(points, far_points(points))
    assert note == (
        "3 of 403 points lie up to 50 times farther out than the rest, which takes 3.9 % of the "
        "image's width"
    )
    assert radius(points[~far]) / radius(points) == pytest.approx(0.039, abs=5e-4)
    many = np.vstack([ball(950_000, 1), np.full((50_000, 3), -9999.0)])
    start = time.process_time()
    assert far_points(many).sum() == 50_000
    assert time.process_time() - start < 5


# --- coordinates in steps -------------------------------------------------------------------------

UTM = np.array([448262.0, 5411933.0, 120.0])


def shifted_back(points: np.ndarray, place: list[float]) -> np.ndarray:
    return (points + place).astype(np.float32).astype(float) - place


def test_steps_that_can_be_seen_are_named_with_their_cause(chair_points: np.ndarray) -> None:
    points = chair_points
    for stored, steps, cause in (
        ((3 * points + UTM).astype(np.float32), "steps of 0.5 where the object is 5", "float32"),
        ((30 * points + UTM).astype(np.float32), "steps of 0.5 where the object is 4", "float32"),
        (np.round(3 * points + UTM), "steps of 1 where the object is 4", "float32 at 5.41e+06"),
        (np.round(points, 1), "steps of 0.1 where the object is", "voxels, few digits, or"),
        (np.round(16 * points), "steps of 1 where the object is", "voxels, few digits, or"),
        (shifted_back(points, [5e5, 5.4e6, 100]), "steps of 0.5 where", "float32 before a shift"),
        (shifted_back(2 * points, [10, 20.3, 5.4e6]), "steps of 0.5 where", "float32 before"),
    ):
        note = note_on_steps(stored.astype(np.float64)) or ""
        assert steps in note
        assert cause in note


def test_steps_too_fine_to_be_seen_and_few_points_have_no_note(chair_points: np.ndarray) -> None:
    points = chair_points
    for stored in (
        points,
        points.astype(np.float32).astype(float),
        3 * points + UTM,
        (300 * points + UTM).astype(np.float32).astype(float),
        np.round(points, 2),
        np.round(3 * points + UTM, 2),
        np.round(100 * points),
        np.round(points[:40], 1),
        points * [1, 1, 0] + [0, 0, 7],
        np.where(np.arange(3) == 1, np.sign(points), points),
        np.ones((99, 3)),
        points[:0],
    ):
        assert note_on_steps(stored) is None
