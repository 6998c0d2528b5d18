from __future__ import annotations

import numpy as np
import pytest

from data_prep.clouds.orientations import (
    AXES,
    MODELNET,
    OURS,
    PAPER,
    SHAPENET_V1,
    SHAPENET_V2,
    Orientation,
    upright,
)
from tests.data_prep.dataset_trees import from_ours

ALL = [OURS, SHAPENET_V1, SHAPENET_V2, MODELNET, PAPER]


def unit(axis: str) -> np.ndarray:
    return (-1 if axis[0] == "-" else 1) * np.eye(3)["xyz".index(axis[-1].lower())]


@pytest.mark.parametrize("orientation", ALL)
def test_up_and_front_arrive_by_a_rotation_that_is_exact(orientation: Orientation) -> None:
    assert orientation.to_ours(unit(orientation.up)).tolist() == [0, 1, 0]
    assert orientation.to_ours(unit(orientation.front)).tolist() == [0, 0, -1]
    assert np.linalg.det(orientation.to_ours(np.eye(3))) == 1.0  # no mirror
    points = np.random.default_rng(0).normal(size=(5, 3)).astype(np.float32)
    back = from_ours(orientation, orientation.to_ours(points))
    assert (back.tobytes(), back.dtype) == (points.tobytes(), np.float32)


def test_version_1_becomes_version_2_as_others_turn_it() -> None:
    # (x, y, z) -> (z, y, -x): the two conversions of shapenet_to_srn.py come to that (Jianfei Guo;
    # from v1 and from v2 to the frame of scene representation networks).
    v1_to_srn = np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]])
    v2_to_srn = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])
    expected = v2_to_srn.T @ v1_to_srn
    assert np.array_equal(SHAPENET_V1.to_ours(np.eye(3)).T, expected)


def test_the_papers_clouds_are_version_1_in_blender() -> None:
    # Blender imports OBJ with (x, y, z) -> (x, -z, y).
    v1 = np.random.default_rng(1).normal(size=(4, 3))
    in_blender = np.stack([v1[:, 0], -v1[:, 2], v1[:, 1]], axis=1)
    assert np.array_equal(PAPER.to_ours(in_blender), SHAPENET_V1.to_ours(v1))


def test_every_pair_of_axes_is_a_turn():
    pairs = [(up, front) for up in AXES for front in AXES if up[-1] != front[-1]]
    turns = {axes: upright(np.eye(3), *axes) for axes in pairs}
    for (up, front), turned in turns.items():
        assert np.linalg.det(turned) == 1  # no mirror
        assert (turned @ turned.T == np.eye(3)).all()
        assert (unit(up) @ turned).tolist() == [0, 1, 0]
        assert (unit(front) @ turned).tolist() == [0, 0, -1]
    assert len({turned.tobytes() for turned in turns.values()}) == 24
    for up in AXES:  # where no front is given
        front = "-y" if up in ("z", "-z") else "-z"
        assert (upright(np.eye(3), up) == turns[up, front]).all()


def test_values_that_are_not_finite_stay_and_our_own_axes_change_no_bit():
    points = np.array([[np.nan, -np.inf, -0.0], [1e-310, 2.0, 3.0]])
    assert upright(points).tobytes() == points.tobytes()
    assert upright(points, "y", "-z").tobytes() == points.tobytes()
    assert upright(np.empty((0, 3)), "z").shape == (0, 3)
    points = np.array([[np.inf, 2.0, np.nan]])
    assert np.array_equal(upright(points, "z"), [[-np.inf, np.nan, 2.0]], equal_nan=True)
