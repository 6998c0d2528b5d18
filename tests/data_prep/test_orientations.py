from __future__ import annotations

import numpy as np
import pytest

from data_prep.orientations import MODELNET, OURS, PAPER, SHAPENET_V1, SHAPENET_V2, Orientation

from .dataset_trees import from_ours

UNIT = {
    f"{sign}{axis}": (1 if sign == "+" else -1) * np.eye(3)["XYZ".index(axis)]
    for sign in "+-"
    for axis in "XYZ"
}
BY_HAND = {
    OURS: ((0, 1, 2), (1, 1, 1)),
    SHAPENET_V1: ((2, 1, 0), (1, 1, -1)),
    SHAPENET_V2: ((0, 1, 2), (1, 1, 1)),
    MODELNET: ((0, 2, 1), (-1, 1, 1)),
    PAPER: ((1, 2, 0), (-1, 1, -1)),
}
ALL = list(BY_HAND)


@pytest.mark.parametrize("orientation", ALL)
def test_up_and_front_arrive_where_they_belong(orientation: Orientation) -> None:
    assert orientation.to_ours(UNIT[orientation.up]).tolist() == UNIT["+Y"].tolist()
    assert orientation.to_ours(UNIT[orientation.front]).tolist() == UNIT["-Z"].tolist()


@pytest.mark.parametrize("orientation", ALL)
def test_a_rotation_and_no_mirror(orientation: Orientation) -> None:
    matrix = orientation.to_ours(np.eye(3)).T
    assert np.array_equal(matrix @ matrix.T, np.eye(3))
    assert np.linalg.det(matrix) == 1.0


@pytest.mark.parametrize("orientation", ALL)
def test_there_and_back_is_exact(orientation: Orientation) -> None:
    points = np.random.default_rng(0).normal(size=(5, 3)).astype(np.float32)
    back = from_ours(orientation, orientation.to_ours(points))
    assert back.tobytes() == points.tobytes()
    assert back.dtype == np.float32


def test_version_1_becomes_version_2_as_others_turn_it() -> None:
    # (x, y, z) -> (z, y, -x): the two conversions of shapenet_to_srn.py come to that (Jianfei Guo;
    # from v1 and from v2 to the frame of scene representation networks).
    v1_to_srn = np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]])
    v2_to_srn = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])
    expected = v2_to_srn.T @ v1_to_srn
    assert np.array_equal(SHAPENET_V1.to_ours(np.eye(3)).T, expected)
    assert SHAPENET_V1.to_ours(np.array([1.0, 2.0, 3.0])).tolist() == [3.0, 2.0, -1.0]


def test_the_papers_clouds_are_version_1_in_blender() -> None:
    # Blender imports OBJ with (x, y, z) -> (x, -z, y).
    v1 = np.random.default_rng(1).normal(size=(4, 3))
    in_blender = np.stack([v1[:, 0], -v1[:, 2], v1[:, 1]], axis=1)
    assert np.array_equal(PAPER.to_ours(in_blender), SHAPENET_V1.to_ours(v1))


def test_the_original_turns_clouds_and_cameras_alike() -> None:
    """Its MeshLab script turns clouds by -90 degrees about y, then z; Blender imports the result;
    its cameras go from p to (p1, -p0, p2). The same rotation: cameras are in the clouds' frame."""

    def about(axis: int, degrees: float) -> np.ndarray:
        cos, sin = round(np.cos(np.radians(degrees))), round(np.sin(np.radians(degrees)))
        one, other = (axis + 1) % 3, (axis + 2) % 3
        matrix = np.eye(3)
        matrix[[one, one, other, other], [one, other, one, other]] = cos, -sin, sin, cos
        return matrix

    into_blender = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])
    of_clouds = into_blender @ about(2, -90) @ about(1, -90)
    of_cameras = np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    assert np.array_equal(of_clouds, of_cameras)


def test_the_message() -> None:
    assert OURS.message == "+Y up, front -Z: taken as it is"
    assert SHAPENET_V1.message == "+Y up, front +X: (x, y, z) becomes (z, y, -x)"
    assert PAPER.message == "+Z up, front +X: (x, y, z) becomes (-y, z, -x)"
