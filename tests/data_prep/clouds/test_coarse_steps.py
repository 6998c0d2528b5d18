from __future__ import annotations

import numpy as np
import pytest

from data_prep.clouds.coarse_steps import note_on_steps
from data_prep.clouds.sampling import sample_surface
from data_prep.datasets.registry import open_dataset
from data_prep.randomness import generator

UTM = np.array([448262.0, 5411933.0, 120.0])


def shifted_back(points: np.ndarray, place: list[float]) -> np.ndarray:
    return (points + place).astype(np.float32).astype(float) - place


@pytest.fixture(scope="module")
def points() -> np.ndarray:
    (chair,) = open_dataset("procedural").objects("chair", 1, 1)
    return sample_surface(chair.load(), generator(0), 2048).points.astype(float)


def test_steps_that_can_be_seen_are_named_with_their_cause(points: np.ndarray) -> None:
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


def test_steps_too_fine_to_be_seen_and_few_points_have_no_note(points: np.ndarray) -> None:
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
